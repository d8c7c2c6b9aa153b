"""Bright spots in a dark picture, such as a lamp on a vehicle, located to a fraction of a pixel."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.opencv import load_opencv

Picture = NDArray[np.uint8]

_RIM_PX: Final = 4
"""So much around a spot counts towards its centre: its skirt tells more than its saturated middle."""
_MOST_SPOTS: Final = 32
"""So many of the largest patches are looked at; noise makes thousands."""
_MOST: Final = 8
"""More spots than this are not looked at one by one: the brightest are."""


class Spot(NamedTuple):
    """One bright spot."""

    column: float
    row: float
    area_px: int
    """Pixels above the threshold."""
    longer_px: int
    """By how much one side is longer than the other: blurred by motion, or two lamps in one."""
    weight: float
    """Sum of the grey values above the background."""


class SpotFinder:
    """Finds spots that are brighter than what is around them and neither tiny nor large.

    Args:
        threshold_grey: A spot's pixels are at least so bright.
        most_area_px: Anything larger is no lamp.
    """

    def __init__(self, threshold_grey: int, most_area_px: int) -> None:
        self._cv2 = load_opencv()
        self._threshold_grey, self._most_area_px = threshold_grey, most_area_px

    def find(self, picture: Picture) -> list[Spot]:
        """The spots of a picture (rows, columns), the brightest first."""
        mask = self._cv2.compare(picture, self._threshold_grey, self._cv2.CMP_GE)
        left, top, width, height = self._cv2.boundingRect(mask)
        if width == 0:
            return []
        # Only where anything is bright: looking for what hangs together costs much more than all the rest.
        bright = mask[top : top + height, left : left + width]
        _, _, stats, _ = self._cv2.connectedComponentsWithStats(bright, connectivity=8)
        stats += (left, top, 0, 0, 0)
        areas = stats[1:, self._cv2.CC_STAT_AREA]
        largest = 1 + np.argsort(-areas, kind="stable")[:_MOST_SPOTS]
        found = [self._spot(picture, row) for row in stats[largest]]
        spots = sorted((spot for spot in found if spot is not None), key=lambda spot: -spot.weight)
        return spots[:_MOST]

    def _spot(self, picture: Picture, stats: NDArray[np.int32]) -> Spot | None:
        left, top, width, height, area = (int(value) for value in stats)
        rows, columns = picture.shape
        is_whole = left > 0 and top > 0 and left + width < columns and top + height < rows
        if not is_whole or area > self._most_area_px or max(width, height) > 4 * min(width, height):
            return None
        x0, y0 = max(0, left - _RIM_PX), max(0, top - _RIM_PX)
        cut = picture[y0 : top + height + _RIM_PX, x0 : left + width + _RIM_PX].astype(float)
        border = np.concatenate((cut[0], cut[-1], cut[:, 0], cut[:, -1]))
        background = float(np.median(border))
        spread = 1.48 * float(np.median(np.abs(border - background)))
        above = np.maximum(cut - background - 4.0 * max(2.0, spread), 0.0)
        weight = float(above.sum())
        if weight <= 0.0:
            return None
        column = float(above.sum(axis=0) @ np.arange(cut.shape[1])) / weight + x0
        row = float(above.sum(axis=1) @ np.arange(cut.shape[0])) / weight + y0
        return Spot(column, row, area, abs(width - height), weight)
