"""Payload outputs: servos, grippers, relays and winches, by the autopilot or by the computer's own pins.

`outputs` has the commands and the interface of devices; the autopilot's device implements it, as does `pins`.
"""

__all__ = ["outputs"]
