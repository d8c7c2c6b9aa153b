"""Arguments of payload actions: cameras, servos, grippers, relays (lamps, pumps, magnets) and winches, by their names."""

from typing import Annotated, Literal

import msgspec

from gloc3.messages.frames import Vector3
from gloc3.mission.model.arguments import Arguments
from gloc3.mission.model.legs import Budget

Distance = Annotated[float, msgspec.Meta(gt=0.0, le=1_000.0)]
OutputName = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,31}$")]


class RecordImages(Arguments, frozen=True, kw_only=True):
    """Take pictures by distance flown or by time, until it is ended or a number of them is taken."""

    one_of = (("every_m", "every_s"),)
    example = "{camera: ground, every_m: 0.5}"

    camera: Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,31}$")]
    every_m: Distance | None = None
    """A picture each time that the vehicle has moved so far."""
    every_s: Annotated[float, msgspec.Meta(ge=0.02, le=3_600.0)] | None = None
    """Interval between pictures."""
    count: Annotated[int, msgspec.Meta(ge=1, le=100_000)] | None = None
    """The action is done after this number of pictures; None to continue until it is ended."""

    @property
    def is_endless(self) -> bool:
        """Without a count it is."""
        return self.count is None

    def time_needed_s(self, start_ned_m: Vector3, budget: Budget) -> float:
        """Known with a count and a time between pictures."""
        del start_ned_m, budget
        return (self.count or 0) * (self.every_s or 0.0)


class SetServo(Arguments, frozen=True, kw_only=True):
    """Move a servo and leave it there."""

    one_of = (("share", "pulse_us"),)
    example = "{servo: tilt, share: 0.5}"

    servo: OutputName
    """Name of the servo on the platform."""
    share: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] | None = None
    """Position from 0, one end of its travel, to 1, the other."""
    pulse_us: Annotated[float, msgspec.Meta(ge=500.0, le=2500.0)] | None = None
    """Length of the pulse, us."""


class Grip(Arguments, frozen=True, kw_only=True):
    """Have a gripper grab or release."""

    example = "{gripper: claw, action: release}"

    gripper: OutputName
    """Name of the gripper on the platform."""
    action: Literal["grab", "release"]
    """What it does."""


class SwitchOutput(Arguments, frozen=True, kw_only=True):
    """Switch a relay, lamp, pump or magnet, for good or for a time."""

    example = "{output: lamp, is_on: true}"

    output: OutputName
    """Name of the relay on the platform."""
    is_on: bool
    """Whether it is switched on, or off."""
    for_s: Annotated[float, msgspec.Meta(ge=0.1, le=3_600.0)] | None = None
    """Time after which it is switched back, also if the action is ended early; without it, it stays switched."""

    def time_needed_s(self, start_ned_m: Vector3, budget: Budget) -> float:
        """The time for which it is switched."""
        del start_ned_m, budget
        return self.for_s or 0.0


class RunWinch(Arguments, frozen=True, kw_only=True):
    """Release a length of line, or wind it in."""

    example = "{winch: hoist, length_m: 5, speed_m_s: 0.5}"

    winch: OutputName
    """Name of the winch on the platform."""
    length_m: Annotated[float, msgspec.Meta(ge=-1_000.0, le=1_000.0)]
    """Length to release; negative to wind in."""
    speed_m_s: Annotated[float, msgspec.Meta(ge=0.01, le=20.0)] = 0.25
    """Speed of the line."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.length_m == 0.0:
            raise ValueError("length_m must not be 0")

    def time_needed_s(self, start_ned_m: Vector3, budget: Budget) -> float:
        """Length by speed."""
        del start_ned_m, budget
        return abs(self.length_m) / self.speed_m_s
