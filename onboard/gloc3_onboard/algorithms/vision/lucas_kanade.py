"""Patch tracking from one picture to another (Lucas and Kanade 1981; in pyramids: Bouguet 2000)."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.opencv import load_opencv
from gloc3_onboard.algorithms.vision.corners import Pixels
from gloc3_onboard.algorithms.vision.picture import Picture

_ITERATIONS: Final = 15
_PRECISION_PX: Final = 0.01
_GREY: Final = 128.0
_ZOOMS: Final = (0.64, 0.8, 1.0, 1.25, 1.5625)
"""Sizes in which patches are tracked that look larger or smaller than they did."""


class PatchTracker:
    """Tracks patches by pyramidal Lucas-Kanade.

    Args:
        window_px: side of a patch.
        error_max: greatest mean grey value difference between a patch and its match, as a share of the patch's
            contrast; unrelated patches differ by about one.
    """

    def __init__(self, window_px: int = 17, error_max: float = 0.55) -> None:
        self._cv2 = load_opencv()
        self._window = (window_px, window_px)
        self._error_max = error_max
        self._criteria = (self._cv2.TERM_CRITERIA_COUNT | self._cv2.TERM_CRITERIA_EPS, _ITERATIONS, _PRECISION_PX)

    def contrast(self, picture: Picture, points: Pixels) -> Pixels:
        """Mean difference of the patches' grey values from the middle grey of an evened picture, (n,)."""
        cv2 = self._cv2
        away = cv2.blur(cv2.absdiff(picture, _GREY), self._window)
        height, width = picture.shape
        column, row = np.rint(points).astype(np.intp).T
        found: Pixels = away[row.clip(0, height - 1), column.clip(0, width - 1)].astype(np.float32)
        return found

    def find(
        self, of: Picture, points: Pixels, contrast: Pixels, into: Picture, guess: Pixels, levels: int
    ) -> tuple[Pixels, NDArray[np.bool_]]:
        """Positions of patches in another picture, (n, 2), and which of them were found.

        Args:
            of: the picture of the points.
            points: centres of the patches, (n, 2).
            contrast: contrast of the patches, (n,).
            into: the other picture.
            guess: initial positions.
            levels: pyramid levels; each doubles the permitted error of the guess.
        """
        if len(points) == 0:
            return points, np.zeros(0, bool)
        # Gauss-Newton on sum (I(x + d) - T(x))^2 over the window, from the coarsest level to the finest.
        found, status, error = self._cv2.calcOpticalFlowPyrLK(
            of,
            into,
            points,
            guess.copy(),
            winSize=self._window,
            maxLevel=levels,
            criteria=self._criteria,
            flags=self._cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        # Gate: mean grey difference against the patch's contrast, and inside of the picture.
        height, width = into.shape
        is_good = (status.ravel() == 1) & (error.ravel() < self._error_max * contrast) & np.isfinite(found).all(axis=1)
        is_good &= (found >= 1.0).all(axis=1) & (found[:, 0] <= width - 2.0) & (found[:, 1] <= height - 2.0)
        return found, is_good

    def find_zoomed(
        self, of: Picture, points: Pixels, contrast: Pixels, into: Picture, guess: Pixels, levels: int, zoom: Pixels
    ) -> tuple[Pixels, NDArray[np.bool_]]:
        """The same for patches that look larger or smaller in the other picture.

        Args:
            of: the picture of the points.
            points: centres of the patches, (n, 2).
            contrast: contrast of the patches, (n,).
            into: the other picture.
            guess: initial positions; not-a-number for points that are not looked for.
            levels: pyramid levels.
            zoom: how much larger the patches are expected to look, (n,).
        """
        cv2 = self._cv2
        steps = np.log(np.array(_ZOOMS))
        nearest = np.abs(np.log(np.maximum(zoom, 1e-3))[:, None] - steps).argmin(axis=1)
        found, is_good = points.copy(), np.zeros(len(points), bool)
        height, width = of.shape
        middle = np.array([(width - 1.0) / 2.0, (height - 1.0) / 2.0])
        is_wanted = np.isfinite(guess).all(axis=1)
        for step, size in enumerate(_ZOOMS):
            which = np.flatnonzero(is_wanted & (nearest == step))
            if len(which) == 0:
                continue
            # Enlarged about the middle, points end near to where a camera that drives ahead sees them.
            away = (1.0 - size) * middle
            resized, places = of, points[which]
            if size != 1.0:
                change = np.array([[size, 0.0, away[0]], [0.0, size, away[1]]])
                resized = cv2.warpAffine(of, change, (width, height), borderMode=cv2.BORDER_REPLICATE)
                places = (places * size + away).astype(np.float32)
            found[which], is_good[which] = self.find(resized, places, contrast[which], into, guess[which], levels)
        return found, is_good
