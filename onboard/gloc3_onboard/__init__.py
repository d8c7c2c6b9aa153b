"""The onboard companion process: components of a vehicle, and the autopilot that they talk to.

`assembly` is the only wiring of a vehicle's side, built from `inputs`; `parts` names what it has made.
"""

__all__ = ["assembly", "inputs", "parts"]
