"""Requests of the autopilot to its simulation: power, true state, injected failures."""

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Protocol

from gloc3_sitl.autopilot.verdict import ACCEPTED, RequestVerdict
from gloc3_sitl.physics.truth import Truth


class SupplyState(IntEnum):
    """Power commands of the autopilot, numbered as the first parameter of MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN."""

    REBOOT = 1
    SHUTDOWN = 2


class FailureUnit(IntEnum):
    """Units that can be made to fail, numbered as FAILURE_UNIT."""

    MAGNETOMETER = 2
    BAROMETER = 3
    GPS = 4
    ODOMETRY = 6
    RANGE_FINDER = 7
    BATTERY = 100
    RECEIVER = 104


class FailureKind(IntEnum):
    """Kinds of failures, numbered as FAILURE_TYPE."""

    OK = 0
    OFF = 1
    STUCK = 2
    GARBAGE = 3
    WRONG = 4
    DELAYED = 6


@dataclass
class SimulatedPayload:
    """What is connected to the autopilot's outputs besides motors, and what it was commanded to."""

    actuators: dict[int, float] = field(default_factory=dict)
    """PX4's actuators of a set, -1 to 1, by number from 1."""
    relays: dict[int, bool] = field(default_factory=dict)
    """By instance from 0."""
    grabs: bool | None = None
    """Whether the gripper holds; None while it has not been commanded."""
    line_m: float = 0.0
    """Length of the winch's line that is out, or will be."""


class Surroundings(Protocol):
    """The simulation, as the autopilot sees it."""

    def switch(self, power: SupplyState) -> None:
        """Reboots the autopilot or powers it off, once its answer is sent."""

    def truth(self) -> Truth:
        """What the vehicle really does."""

    def inject(self, unit: FailureUnit, failure: FailureKind) -> RequestVerdict:
        """Makes something fail, or repairs it."""

    def correct(self, corrections: bytes) -> None:
        """Passes corrections of a base (RTCM 3) to the satellite receiver."""


class Nowhere:
    """Surroundings without effect, for an autopilot without a simulation."""

    def switch(self, power: SupplyState) -> None:
        """Does nothing."""

    def truth(self) -> Truth:
        """There is none.

        Raises:
            LookupError: always.
        """
        raise LookupError("no simulation")

    def inject(self, unit: FailureUnit, failure: FailureKind) -> RequestVerdict:
        """Does nothing."""
        del unit, failure
        return ACCEPTED

    def correct(self, corrections: bytes) -> None:
        """Does nothing."""
