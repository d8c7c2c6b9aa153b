"""Sources of 3D scanners, one file a make; the registry finds them by name.

`lidar` has what they share: the sensor kind, the mounting, and the replay from logs.
"""

__all__ = ["lidar"]
