"""The sensors of the onboard process: their devices as samplers see them, where their data comes from, whether they deliver.

The registry makes devices from the URLs of a platform; hardware, simulation and logs implement the same protocols.
"""

__all__ = ["devices", "line", "pictures", "registry", "replay", "rig", "sensor_watch", "source_url", "threaded"]
