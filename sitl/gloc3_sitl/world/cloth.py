"""A texture pyramid at full, half, quarter… resolution, with tiling."""

from functools import lru_cache
from math import log2
from typing import Any, Final

import numpy as np

from gloc3.camera.opencv import load_opencv
from gloc3_sitl.world.model import Marker, Texture
from gloc3_sitl.world.texture import (
    MARKER_CELLS,
    MARKER_PIXELS_PER_CELL,
    NEUTRAL,
    Image,
    paint,
    paint_marker,
    tint_of,
)

RIM_PX: Final = 2
_SMALL_PX: Final = 24
_SPAN_PX: Final = 1400
"""What a band of a surface covers of its texture at most, as a rule, when its resolution fits that of the picture."""


class TextureLevel:
    """One resolution of a texture, with a rim that keeps interpolation inside the edge.

    OpenCV is ten times slower with any border mode other than a constant border.
    """

    def __init__(self, cv2: Any, bare: Image, scale_px_m: float, *, is_repeated: bool) -> None:
        self.bare = bare
        """One period, without the rim."""
        self.scale_px_m = scale_px_m
        rows, columns = bare.shape[:2]
        self.period_px = (columns, rows)
        if not is_repeated:
            self.sheet = cv2.copyMakeBorder(bare, RIM_PX, RIM_PX, RIM_PX, RIM_PX, cv2.BORDER_REPLICATE)
            return
        beyond = RIM_PX + _SPAN_PX
        self.sheet = cv2.copyMakeBorder(bare, RIM_PX, beyond, RIM_PX, beyond, cv2.BORDER_WRAP)


class Cloth:
    """A painted texture; each resolution is made when it is first needed."""

    def __init__(self, cv2: Any, picture: Image, pixels_per_m: float, *, is_repeated: bool = True) -> None:
        self._cv2 = cv2
        self._is_repeated = is_repeated
        self.is_repeated: Final = is_repeated
        self._pixels_per_m = pixels_per_m
        self._bare = [picture]
        while min(self._bare[-1].shape[:2]) > _SMALL_PX and all(side % 2 == 0 for side in self._bare[-1].shape[:2]):
            half = cv2.resize(self._bare[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            self._bare.append(half)
        self._levels: list[TextureLevel | None] = [None] * len(self._bare)

    def level(self, pixel_m: float) -> TextureLevel:
        """The resolution that fits a pixel width on the surface."""
        wanted = round(log2(max(pixel_m * self._pixels_per_m, 1e-9)))
        index = min(max(0, wanted), len(self._bare) - 1)
        found = self._levels[index]
        if found is None:
            scale_px_m = self._pixels_per_m / 2**index
            found = TextureLevel(self._cv2, self._bare[index], scale_px_m, is_repeated=self._is_repeated)
            self._levels[index] = found
        return found


@lru_cache(maxsize=24)
def cloth_of(texture: Texture) -> Cloth:
    """The cloth of a texture, one for all cameras of the process."""
    cv2 = load_opencv()
    return Cloth(cv2, paint(texture), texture.resolution_px_m)


@lru_cache(maxsize=24)
def tint_cloth_of(texture: Texture) -> Cloth:
    """The colours of a texture, likewise."""
    return Cloth(load_opencv(), tint_of(texture), texture.resolution_px_m)


@lru_cache(maxsize=4)
def cloth_of_marker(marker: Marker) -> Cloth:
    """The tag with its white border."""
    cv2 = load_opencv()
    side_m = marker.size_m * MARKER_CELLS / 6.0
    return Cloth(cv2, paint_marker(marker), MARKER_CELLS * MARKER_PIXELS_PER_CELL / side_m, is_repeated=False)


@lru_cache(maxsize=4)
def tint_cloth_of_marker(marker: Marker) -> Cloth:
    """The tag's colours: none."""
    cv2 = load_opencv()
    side_m = marker.size_m * MARKER_CELLS / 6.0
    pixels = MARKER_CELLS * MARKER_PIXELS_PER_CELL
    return Cloth(cv2, np.full((pixels, pixels, 3), NEUTRAL, np.uint8), pixels / side_m, is_repeated=False)
