"""The interface between decisions and motors: how every class of vehicle handles a setpoint."""

from collections.abc import Sequence
from typing import Protocol

from gloc3.messages.frames import Quaternion
from gloc3_sitl.autopilot.control.setpoint import Setpoint

Outputs = Sequence[float]
"""Outputs to motors and control surfaces, in the body's order: 0 to 1, or -1 to 1 where reversible."""


class ControlLoops(Protocol):
    """Control loops of one vehicle, made with its `Craft`, from which it reads estimate, tuning and time."""

    @property
    def stopped(self) -> Outputs:
        """Outputs while the vehicle is not armed."""
        ...

    @property
    def thrust(self) -> float:
        """Commanded drive as a fraction of full, for telemetry."""
        ...

    @property
    def wanted_attitude(self) -> Quaternion:
        """Attitude that is steered to, `ned_from_frd`, for the telemetry."""
        ...

    def follow(self, setpoint: Setpoint) -> None:
        """Handles the mode's setpoint every 20 ms, and updates `craft.touchdown`."""
        ...

    def outputs(self) -> Outputs:
        """The outputs for the next 5 ms, while armed."""
        ...
