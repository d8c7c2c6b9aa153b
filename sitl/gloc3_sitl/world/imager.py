"""Exposure settings of a camera, and its pictures."""

from typing import Annotated

import msgspec

from gloc3_sitl.world.model import Positive
from gloc3_sitl.world.texture import Image


class Imager(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Exposure settings of a camera, without its lens."""

    name: str
    """The camera's name."""
    rate_hz: Positive = 15.0
    """Pictures per second."""
    noise_grey: Annotated[float, msgspec.Meta(ge=0.0, le=50.0)] = 1.5
    """Standard deviation of each pixel's noise."""
    sensitivity: Annotated[float, msgspec.Meta(gt=0.0, le=8.0)] = 1.0
    """Factor on all grey values; low for a camera that should see lights only."""


class Photo(msgspec.Struct, frozen=True, kw_only=True):
    """A picture and when it was taken."""

    t_s: float
    """The middle of the exposure."""
    pixels: Image
    """Grey values, rows by columns."""
    bgr: Image | None = None
    """The same in blue, green and red, `(rows, columns, 3)`; None for a camera that is not in colour."""
