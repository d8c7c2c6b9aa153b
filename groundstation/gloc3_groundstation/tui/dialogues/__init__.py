"""Dialogues over a screen that ask for more than yes or no.

Each is a modal screen that returns an answer or None.
"""

__all__ = [
    "component_dialogues",
    "fly_by_sticks",
    "mission_files",
    "questions",
    "single_action",
    "teleoperate",
]
