"""Checks of sensor data that need not know the sensor: order in time, whole pictures, sane ranges; no I/O.

Pure checks; each returns a reason in words.
"""

__all__ = ["depth_check", "estimator_check", "frame_check", "obstacles", "recent", "scan_check", "silence", "timeline"]
