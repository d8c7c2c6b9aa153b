"""Vehicles in the graph of ROS 2: their topics and diagnostics, and services that command their missions.

`bridge` publishes, `missions` commands; `gloc3 ros2` runs both beside a station.
"""

__all__ = ["bridge", "missions"]
