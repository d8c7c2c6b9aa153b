"""Conversion of logs to the files of other programs: maps, tables, and ROS 2 bags.

`conversion` does it by the name of a format; libraries beyond the plain installation are imported where they are used.
"""

__all__ = ["conversion"]
