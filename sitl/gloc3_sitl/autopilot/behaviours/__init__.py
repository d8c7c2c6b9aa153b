"""What the vehicle can do, one class each: told the time, it gives a setpoint every 20 ms.

`choice` says which class of vehicle has which; each is a small machine that returns setpoints.
"""

__all__ = ["base", "choice", "driving", "hold", "mission", "orbit", "streamed", "submarine", "touching_down", "winged"]
