"""The cascade of control loops, from a wanted position down to four throttles.

One loop a file; `control` is the seam that every class of vehicle fills.
"""

__all__ = [
    "control",
    "drive",
    "drive_gains",
    "lateral",
    "motor_test",
    "multirotor",
    "position",
    "setpoint",
    "trajectory",
    "underwater",
    "vtol",
    "vtol_form",
    "wing_gains",
    "wings",
]
