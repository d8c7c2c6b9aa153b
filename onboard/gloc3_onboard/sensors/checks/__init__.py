"""What is known of sensors' data without knowing the sensor: order in time, whole pictures, sane ranges; no I/O.

Pure checks; each returns a reason in words.
"""

__all__ = ["frame_check", "obstacles", "recent", "scan_check", "silence", "timeline"]
