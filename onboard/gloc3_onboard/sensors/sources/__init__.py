"""One file a kind of sensor or of source: its URL scheme, its device, its replay, and the rows that declare them.

The registry finds every module here, so a new kind is one file. A module lists `SENSORS` and `SOURCES`.
"""

__all__ = ["autopilot", "estimator_wire", "euroc", "kitti", "laser"]
