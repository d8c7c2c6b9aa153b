"""Other air traffic, from ADS-B receivers and Remote ID: who is near which vehicle, and whether they come closer.

`traffic` is the service; `reports` reads messages, `encounters` compares positions.
"""

__all__ = ["traffic"]
