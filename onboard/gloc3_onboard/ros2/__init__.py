"""Nodes of ROS 2 in a vehicle: as sources of sensors' data, and lifecycle nodes as components.

`sources` are found by the registry of sensors, `lifecycle` is the device `ros2` of a platform file.
"""

__all__ = ["lifecycle"]
