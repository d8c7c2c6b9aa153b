"""Points of the ground, found in a key frame and followed in the pictures after it."""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Picture = NDArray[np.uint8]

_CELLS: Final = 105
"""About so many points are looked for: one in each square cell of a grid."""
_WINDOW_PX: Final = 15
_BORDER_PX: Final = 12
_LEAST_EIGENVALUE: Final = 4e-4
"""A corner is weaker than this in noise alone (OpenCV's measure, at half the size)."""
_GAIN: Final = 0.08
"""Pictures that differ more than this in contrast, or by `_OFFSET_GREY` in brightness, are made alike first."""
_OFFSET_GREY: Final = 6.0
_THINNED: Final = 5
"""Every so many rows and columns tell how bright a picture is."""
_BARE_GREY: Final = 2.0
_DARK_GREY: Final = 20.0


class Light(NamedTuple):
    """How bright a picture is, and how contrasty."""

    mean: float
    deviation: float


class GroundTracks:
    """Grid-spread corners of a key frame, followed by Lucas and Kanade's method from the key frame itself."""

    def __init__(self) -> None:
        import cv2

        self._cv2: Any = cv2
        self._key: Picture | None = None
        self._light = Light(0.0, 1.0)

    def begin(self, picture: Picture, kept_px: Array) -> Array:
        """Makes a picture the key frame.

        Args:
            picture: Grey values, (rows, columns).
            kept_px: Points to go on with, (n, 2).

        Returns:
            New points in cells that none of them is in, (m, 2).
        """
        self._key, self._light = picture, _light(picture)
        return self._corners(picture, kept_px)

    def follow(self, picture: Picture, points_px: Array, expected_px: Array, *, is_sure: bool) -> tuple[Array, Flags]:
        """Finds the points of the key frame again.

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
        cv2 = self._cv2
        found, status, _ = cv2.calcOpticalFlowPyrLK(
            self._key,
            self._alike(picture),
            points_px.astype(np.float32).reshape(-1, 1, 2),
            expected_px.astype(np.float32).reshape(-1, 1, 2).copy(),
            winSize=(_WINDOW_PX, _WINDOW_PX),
            maxLevel=2 if is_sure else 4,
            criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.02),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            minEigThreshold=1e-4,
        )
        pixels = found.reshape(-1, 2).astype(float)
        rows, columns = picture.shape
        is_inside = (pixels > _WINDOW_PX / 2).all(axis=1)
        is_inside &= (pixels[:, 0] < columns - 1 - _WINDOW_PX / 2) & (pixels[:, 1] < rows - 1 - _WINDOW_PX / 2)
        return pixels, (status.reshape(-1) == 1) & is_inside

    def _alike(self, picture: Picture) -> Picture:
        """The picture with the brightness and the contrast of the key frame."""
        now, key = _light(picture), self._light
        gain = key.deviation / max(now.deviation, 1.0)
        if abs(gain - 1.0) < _GAIN and abs(now.mean - key.mean) < _OFFSET_GREY:
            return picture
        gain = min(max(gain, 0.25), 4.0)
        table = np.clip((np.arange(256) - now.mean) * gain + key.mean, 0.0, 255.0).astype(np.uint8)
        alike: Picture = self._cv2.LUT(picture, table)
        return alike

    def _corners(self, picture: Picture, kept_px: Array) -> Array:
        """The best corner of each cell that holds none yet; searched at half the size."""
        cv2 = self._cv2
        half = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        strength = cv2.cornerMinEigenVal(half, 5, ksize=3)
        cell = max(4, round(math.sqrt(strength.size / _CELLS)))
        border = _BORDER_PX // 2
        rows, columns = (strength.shape[0] - 2 * border) // cell, (strength.shape[1] - 2 * border) // cell
        if rows < 1 or columns < 1:
            return np.zeros((0, 2))
        cut = strength[border : border + rows * cell, border : border + columns * cell]
        cells = cut.reshape(rows, cell, columns, cell).transpose(0, 2, 1, 3).reshape(rows * columns, cell * cell)
        best = cells.argmax(axis=1)
        is_taken = cells[np.arange(len(cells)), best] < _LEAST_EIGENVALUE
        where = np.floor((kept_px / 2.0 - border) / cell).astype(int)
        is_within = (where >= 0).all(axis=1) & (where[:, 0] < columns) & (where[:, 1] < rows)
        is_taken[where[is_within, 1] * columns + where[is_within, 0]] = True
        free = np.flatnonzero(~is_taken)
        down, across = np.divmod(best[free], cell)
        column = border + (free % columns) * cell + across
        row = border + (free // columns) * cell + down
        return np.column_stack((column, row)) * 2.0 + 0.5


def nothing_in(picture: Picture) -> str:
    """Says so where a picture is all of one grey; empty where there is something in it."""
    light = _light(picture)
    if light.deviation > _BARE_GREY:
        return ""
    if _DARK_GREY < light.mean < 255.0 - _DARK_GREY:
        return "the picture is bare"
    return "the picture is black" if light.mean <= _DARK_GREY else "the picture is white"


def _light(picture: Picture) -> Light:
    thin = picture[::_THINNED, ::_THINNED]
    return Light(float(thin.mean()), float(thin.std()))
