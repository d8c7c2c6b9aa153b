"""Water: where its surface and floor are, how it flows, and how it waves."""

from typing import Annotated, Final

import msgspec

from gloc3.frames import Vector3

Height = Annotated[float, msgspec.Meta(ge=-11_000.0, le=1e5)]


class Waves(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A sea that the wind has raised, long-crested."""

    height_m: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)]
    """Significant height: the mean of the highest third, from trough to crest."""
    period_s: Annotated[float, msgspec.Meta(ge=1.0, le=30.0)] = 4.0
    """Of the waves that carry most of the energy."""
    from_deg: Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)] = 0.0
    """Bearing that they come from, clockwise from north."""


class Water(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The water of a world."""

    surface_m: Height = 0.0
    """Height of the still surface in the world's frame."""
    floor_m: Height = -1000.0
    """Height of its floor."""
    current_ned_m_s: Vector3 = (0.0, 0.0, 0.0)
    """Velocity of the water, north, east and down."""
    waves: Waves | None = None


STILL: Final = Water()
"""Deep water without current or waves."""
