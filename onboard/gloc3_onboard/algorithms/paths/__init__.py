"""Keeps a vehicle on a path and inside its limits: path follower, limits, distances to walls and floor.

Pure functions and small machines in NED.
"""

__all__ = ["floor_keeper", "leader", "motion_limits", "path_follower", "setpoint_gate", "wall_keeper"]
