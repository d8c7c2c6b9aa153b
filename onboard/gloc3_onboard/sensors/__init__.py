"""The sensors of the onboard process: devices as seen by samplers, sources of their data, and checks that they deliver.

The registry creates devices from a platform's URLs; hardware, simulation and logs implement the same protocols.
"""

__all__ = ["devices", "line", "pictures", "registry", "replay", "rig", "sensor_watch", "source_url", "threaded"]
