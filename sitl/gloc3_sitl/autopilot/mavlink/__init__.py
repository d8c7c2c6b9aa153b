"""The autopilot's MAVLink front end: links, streams, commands and setpoints.

`front` is its face to the simulator; telemetry and commands are tables.
"""

__all__ = ["calibration", "front", "links"]
