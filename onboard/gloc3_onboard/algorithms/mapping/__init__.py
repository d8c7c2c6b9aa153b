"""Obstacles in the plane: those of one scan with what moves among them, the map of all scans, and ways in it.

The limiter and the path follower use `obstacle_field` and `movers`; the map and the planner use the rest.
"""

__all__ = ["movers", "obstacle_field", "obstacle_memory", "occupancy", "route_planner"]
