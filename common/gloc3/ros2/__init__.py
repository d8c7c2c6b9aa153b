"""ROS 2 without a ROS installation: messages of what GLOC3 reports, and nodes on the wire of `rmw_zenoh`.

`definitions` are the types; `messages` converts ours, in the axes of REP 103: the map is east, north, up, the body
forward, left, up. `node` is a node with publishers, subscriptions and services, by the keys and tokens of `wire`.
"""

__all__ = ["definitions", "messages", "node", "wire"]
