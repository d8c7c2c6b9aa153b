"""Corner detection: the best corner of each cell of a grid."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.opencv import load_opencv
from gloc3_onboard.algorithms.vision.picture import Picture

Pixels = NDArray[np.float32]

_HALF: Final = 2
"""Corners are found at half resolution: the exact position of a patch is irrelevant if it is distinctive."""


class GridCorners:
    """Finds the strongest corner of each cell (Shi and Tomasi 1994: the lesser eigenvalue of the gradients' matrix).

    Args:
        cell_px: side of a cell.
        least: the least strength of a corner, about its contrast in grey values; noise alone has less.
        margin_px: nearest that a corner may be to the picture's edge.
    """

    def __init__(self, cell_px: int = 40, least: float = 4.0, margin_px: int = 14) -> None:
        self._cv2 = load_opencv()
        self._cell = cell_px // _HALF
        self._least = least
        self._margin = margin_px // _HALF

    def find(self, picture: Picture, used: Pixels) -> Pixels:
        """Corners in the cells that hold none yet, strongest first.

        Args:
            picture: evened out.
            used: the points that are there already, (n, 2).
        """
        cv2, cell = self._cv2, self._cell
        small = cv2.resize(picture, None, fx=1.0 / _HALF, fy=1.0 / _HALF, interpolation=cv2.INTER_AREA)
        rows, columns = small.shape[0] // cell, small.shape[1] // cell
        strength = np.maximum(cv2.cornerMinEigenVal(small, 5, ksize=3), 0.0)  # rounding makes some negative
        edge = self._margin
        strength[:edge], strength[-edge:], strength[:, :edge], strength[:, -edge:] = 0.0, 0.0, 0.0, 0.0
        tiles = strength[: rows * cell, : columns * cell].reshape(rows, cell, columns, cell).swapaxes(1, 2)
        flat = tiles.reshape(rows * columns, cell * cell)
        best = flat.argmax(axis=1)
        value = flat[np.arange(len(flat)), best]
        if len(used):
            at = (used / (_HALF * cell)).astype(np.intp)
            is_inside = (at[:, 0] < columns) & (at[:, 1] < rows) & (at >= 0).all(axis=1)
            value[at[is_inside, 1] * columns + at[is_inside, 0]] = 0.0
        chosen = np.flatnonzero(np.sqrt(value) * 255.0 > self._least)
        chosen = chosen[np.argsort(-value[chosen], kind="stable")]
        row = (chosen // columns) * cell + best[chosen] // cell
        column = (chosen % columns) * cell + best[chosen] % cell
        middle = (_HALF - 1) / 2.0
        return np.column_stack([column * _HALF + middle, row * _HALF + middle]).astype(np.float32)
