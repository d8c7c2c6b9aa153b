"""The parts of a mission: tasks, actions, arguments, conditions, policies, the fence and the legs of its path.

States and transitions are one table for all three levels.
"""

__all__ = [
    "abilities",
    "arguments",
    "conditions",
    "exploring",
    "fence",
    "legs",
    "messages",
    "model",
    "patterns",
    "payload",
    "placement",
    "pointing",
    "policy",
    "states",
    "structure",
    "waypoint_options",
]
