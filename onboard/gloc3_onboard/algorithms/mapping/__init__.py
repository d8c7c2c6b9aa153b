"""Obstacles as points in the plane, and moving objects among them.

Built from scans, used by the limiter and the path follower.
"""

__all__ = ["movers", "obstacle_field"]
