"""Points of the ground, detected in a key frame and tracked in later pictures."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3_onboard.algorithms.vision.corners import GridCorners, Pixels
from gloc3_onboard.algorithms.vision.lucas_kanade import PatchTracker
from gloc3_onboard.algorithms.vision.picture import LightEvener, Picture

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_CELLS: Final = 84
"""Approximate number of points: one in each square cell of a grid."""
_WINDOW_PX: Final = 13
_ERROR_MAX: Final = 0.8
"""Loose limit: the plane fit decides later which points move with the floor."""
_SURE_LEVELS: Final = 2
_FAR_LEVELS: Final = 4


class GroundTracks:
    """Corners of a key frame, spread on a grid and tracked from the key frame itself, in equalized light.

    Args:
        width: width of the pictures.
        height: height of the pictures.
    """

    def __init__(self, width: int, height: int) -> None:
        self._light = LightEvener()
        cell_px = max(8, 2 * round(math.sqrt(width * height / _CELLS) / 2.0))
        self._corners = GridCorners(cell_px)
        self._patches = PatchTracker(_WINDOW_PX, _ERROR_MAX)
        self._key: Picture | None = None
        self._contrast: Pixels | None = None
        """Of the patches of the key frame."""
        self._raw: Picture | None = None
        self._even: Picture | None = None

    def begin(self, picture: Picture, kept_px: Array) -> Array:
        """Makes a picture the key frame.

        Args:
            picture: Grey values, (rows, columns).
            kept_px: Points to keep, (n, 2).

        Returns:
            New points in empty cells, (m, 2).
        """
        self._key, self._contrast = self._evened(picture), None
        return self._corners.find(self._key, kept_px.astype(np.float32)).astype(float)

    def follow(self, picture: Picture, points_px: Array, expected_px: Array, *, is_sure: bool) -> tuple[Array, Flags]:
        """Tracks the points of the key frame.

        Args:
            picture: Grey values, (rows, columns), of the size of the key frame.
            points_px: The points in the key frame, (n, 2).
            expected_px: Where they are expected, (n, 2).
            is_sure: Whether the expectation is good to some pixels, so that less is searched.

        Returns:
            Where they are (n, 2), and which of them were found (n,).
        """
        if self._key is None or len(points_px) == 0:
            return expected_px, np.zeros(len(points_px), np.bool_)
        points, guess = points_px.astype(np.float32), expected_px.astype(np.float32)
        if self._contrast is None or len(self._contrast) != len(points):
            self._contrast = self._patches.contrast(self._key, points)
        levels = _SURE_LEVELS if is_sure else _FAR_LEVELS
        found, is_good = self._patches.find(self._key, points, self._contrast, self._evened(picture), guess, levels)
        rows, columns = picture.shape
        edge = _WINDOW_PX / 2.0
        is_good &= (found > edge).all(axis=1) & (found < np.array([columns - 1, rows - 1]) - edge).all(axis=1)
        return found.astype(float), is_good

    def _evened(self, picture: Picture) -> Picture:
        """The light of a picture evened out, once."""
        if self._even is None or picture is not self._raw:
            self._raw, self._even = picture, self._light.even(picture)
        return self._even
