"""Other vehicles near a vehicle, as a station passes them on, and the limiter's answer to them.

Topics, below the platform's name: `neighbours`, `separation`.
"""

import msgspec

from gloc3.messages.envelope import Message
from gloc3.messages.frames import Vector3


class Neighbour(msgspec.Struct, frozen=True, array_like=True):
    """Another vehicle in the air, in the vehicle's own NED."""

    name: str
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    t_s: float
    """For which time, on the platform's clock."""
    has_priority: bool = False
    """Whether this vehicle gives way to it."""


class Neighbours(Message, frozen=True):
    """The other vehicles that matter, as they were reported last."""

    vehicles: list[Neighbour] = []


class SeparationState(Message, frozen=True):
    """What the limiter does to keep the separation; reported on change."""

    name: str = ""
    """The other vehicle; empty while nothing has to be done."""
    distance_m: float = 0.0
    """To it, now."""
    has_priority: bool = False
    """Whether this vehicle gives way to it; else both brake, since it has not."""
