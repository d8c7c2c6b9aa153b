"""Joysticks and gamepads of any make: devices, mappings to a vehicle's axes, the dead-man's key.

Dialogues open a `reader` and steer by a `hand_on_joystick`; nothing else knows of devices.
"""

__all__ = [
    "defaults",
    "detection",
    "device",
    "hand_on_joystick",
    "listener",
    "mapping",
    "reader",
]
