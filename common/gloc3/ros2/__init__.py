"""ROS 2 messages of what GLOC3 reports, without a ROS installation.

`definitions` are the types; `messages` converts ours, in the axes of REP 103: the map is east, north, up, the body
forward, left, up.
"""

__all__ = ["definitions", "messages"]
