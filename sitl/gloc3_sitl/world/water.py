"""The water of a world: its surface, its floor, its current and its waves."""

from typing import Annotated

import msgspec

from gloc3.frames import Vector3


class Waves(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A sea state: long-crested irregular waves with a modified Pierson-Moskowitz spectrum (ITTC 2002)."""

    height_m: Annotated[float, msgspec.Meta(ge=0.0, le=15.0)] = 0.0
    """Significant wave height: four times the standard deviation of the surface; 0 is flat."""
    period_s: Annotated[float, msgspec.Meta(ge=1.0, le=25.0)] = 4.0
    """Period of the spectrum's peak."""
    from_deg: Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)] = 0.0
    """Bearing that they come from, clockwise from north."""


class Water(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Water that fills a world from its floor to its surface."""

    surface_m: Annotated[float, msgspec.Meta(ge=-1e3, le=1e3)] = 0.0
    """Height of the calm surface in the world's frame."""
    floor_m: Annotated[float, msgspec.Meta(ge=-1.1e4, le=1e3)] = -30.0
    """Height of the level floor; boxes may stand on it."""
    current_ned_m_s: Vector3 = (0.0, 0.0, 0.0)
    """Steady velocity of the water over ground."""
    waves: Waves = Waves()


FLAT = Waves()
"""No waves."""
STILL = Water()
"""Still water, 30 m deep."""
