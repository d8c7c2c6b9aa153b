"""The vehicle's behaviours, one class each: a setpoint every 20 ms.

`choice` says which class of vehicle has which; each is a small machine that returns setpoints.
"""

__all__ = [
    "base",
    "choice",
    "driving",
    "hold",
    "land",
    "orbit",
    "piloted",
    "submarine",
    "touching_down",
    "vtol",
    "winged",
]
