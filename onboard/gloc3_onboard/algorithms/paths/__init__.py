"""Keeps a vehicle on a path and inside its limits: path follower, limits, distances to walls and floor.

Pure functions and small state machines in NED.
"""

__all__ = [
    "floor_clearance",
    "motion_limits",
    "path_follower",
    "path_reference",
    "separation",
    "setpoint_gate",
    "wall_distance",
]
