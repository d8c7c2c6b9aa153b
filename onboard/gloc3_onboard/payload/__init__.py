"""Payload: servos, grippers, relays and winches, by the autopilot or by the computer's own pins, and gimbals.

`outputs` has the commands and the interface of devices with outputs, `pointing` those of gimbals; the autopilot's link
implements the first, as does `pins`, and `gimbal_link` the second.
"""

__all__ = ["gimbal_link", "outputs", "pointing"]
