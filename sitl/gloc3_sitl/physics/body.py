"""The interface between the simulator and a vehicle's physics."""

from collections.abc import Callable, Sequence
from typing import Protocol

import msgspec

from gloc3.messages.frames import IDENTITY, GeoPoint, Quaternion, Vector3
from gloc3_sitl.physics.truth import TrueMotion
from gloc3_sitl.physics.water import STILL, Water
from gloc3_sitl.physics.wind import CALM, Wind


class Situation(msgspec.Struct, frozen=True, kw_only=True):
    """Initial position and environment of a body."""

    home: GeoPoint
    """The ground (or the surface of the water) at the place of departure, and the origin of NED."""
    wind: Wind = CALM
    water: Water = STILL
    """Of what swims; its heights count from the home."""
    seed: int = 0
    """Of turbulence and waves."""
    rate_hz: int = 200
    """Steps per second."""
    heading_deg: float = 0.0
    """At the start, clockwise from north."""


class VehicleBody(TrueMotion, Protocol):
    """A vehicle's physics, at rest at its home to begin with.

    The same situation and outputs give the same trajectory bit for bit, in any process.
    """

    @property
    def rate_hz(self) -> int:
        """Steps per second."""
        ...

    @property
    def steps(self) -> int:
        """Steps done since the start."""
        ...

    @property
    def now_s(self) -> float:
        """Simulated seconds since the start."""
        ...

    @property
    def mass_kg(self) -> float:
        """Mass of the whole vehicle."""
        ...

    @property
    def standing_height_m(self) -> float:
        """Height of the centre of gravity over the standing point."""
        ...

    wind: Wind
    """What the air does; may be set at any time."""

    def set_ground(self, altitude_m: float) -> None:
        """Raises or lowers the ground under the vehicle to this altitude above mean sea level."""
        ...

    def place(
        self,
        position_ned_m: Vector3,
        attitude_wxyz: Quaternion = IDENTITY,
        velocity_ned_m_s: Vector3 = (0.0, 0.0, 0.0),
    ) -> None:
        """Places the vehicle with its motors stopped and without turn rate; its time continues."""
        ...

    def step(self, outputs: Sequence[float], /) -> None:
        """Advances by one period; outputs that are out of range or not numbers are clipped."""
        ...


MakeBody = Callable[[Situation], VehicleBody]
