"""The onboard companion process: components of a vehicle, and their interface to the autopilot.

`assembly` is the only wiring of a vehicle's side, built from `inputs`; `parts` lists the created objects.
"""

__all__ = ["assembly", "inputs", "parts"]
