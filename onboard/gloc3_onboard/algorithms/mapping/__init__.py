"""Obstacles as points in the plane, and what moves among them.

Made from scans, read by the limiter and the path follower.
"""

__all__ = ["movers", "obstacle_field"]
