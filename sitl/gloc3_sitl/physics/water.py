"""Water: surface and floor, current and waves."""

from typing import Annotated, Final

import msgspec
from msgspec.structs import replace

from gloc3.messages.frames import Vector3

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


def rough(water: Water, *, waves_m: float = 0.0, waves_from_deg: float = 0.0, current_m_s: float = 0.0) -> Water:
    """The same water with waves, and with a current to the north, where they are wanted."""
    if waves_m > 0.0:
        water = replace(water, waves=Waves(height_m=waves_m, from_deg=waves_from_deg))
    return replace(water, current_ned_m_s=(current_m_s, 0.0, 0.0)) if current_m_s else water


STILL: Final = Water()
"""Deep water without current or waves."""
