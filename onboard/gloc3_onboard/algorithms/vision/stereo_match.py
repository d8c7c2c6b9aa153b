"""Left-right matching: a search along the epipolar line, then patch tracking."""

from typing import Any, Final

import numpy as np

from gloc3.camera.opencv import load_opencv
from gloc3_onboard.algorithms.vision.corners import Pixels
from gloc3_onboard.algorithms.vision.lucas_kanade import PatchTracker
from gloc3_onboard.algorithms.vision.picture import Picture
from gloc3_onboard.algorithms.vision.stereo_rig import StereoRig

_COARSE: Final = 4
"""Search step, px: every fourth pixel, at a quarter of the resolution."""
_REACH: Final = 3
"""Half a side of the patches that are compared, in coarse pixels."""
_ALIKE_MIN: Final = 0.6
_SECOND_MAX: Final = 0.9
"""Similarity of the second best match, relative to the best, above which a match is ambiguous."""
_FEW: Final = 8
_EPIPOLAR_MAX_PX: Final = 1.2
_ROW_GAIN: Final = 0.3
"""Share of a new measurement in the mean distance of matches from their line."""
_DISPARITY_MIN_PX: Final = 0.3


class StereoMatcher:
    """Matches points between the pictures of a pair.

    Args:
        rig: the calibrated pair.
        nearest_m: nearest that anything is expected to be.
        tracker: follows patches.
    """

    def __init__(self, rig: StereoRig, nearest_m: float, tracker: PatchTracker) -> None:
        self._cv2 = load_opencv()
        self._rig = rig
        self._tracker = tracker
        most_px = rig.baseline_m / nearest_m * rig.focal_px
        self._steps = np.arange(0.0, most_px + _COARSE, _COARSE) / rig.focal_px
        self._off_px: Any = np.zeros(0)
        self._row_px = 0.0

    def problem(self) -> str:
        """Why the last matches contradict the calibration; empty if they do not."""
        if len(self._off_px) < _FEW:
            return ""
        off_px = float(np.median(self._off_px))
        spread_px = float(np.median(np.abs(self._off_px - off_px)))
        if abs(off_px) < _EPIPOLAR_MAX_PX or spread_px > abs(off_px) / 2.0:
            return ""
        return f"the calibration does not fit: matches are {abs(off_px):.1f} pixels off the line that it says"

    def _learn_row(self) -> None:
        """Learns how far all matches are off their line, as far as a calibration may be wrong."""
        if len(self._off_px) >= _FEW:
            off_px = float(np.clip(np.median(self._off_px), -_EPIPOLAR_MAX_PX, _EPIPOLAR_MAX_PX))
            self._row_px += _ROW_GAIN * (off_px - self._row_px)

    def match(self, left: Picture, points: Pixels, contrast: Pixels, right: Picture, guess: Pixels) -> Pixels:
        """Matches in the right picture, (n, 2), from a guess; not-a-number for points without a match."""
        found, is_good = self._tracker.find(left, points, contrast, right, np.nan_to_num(guess, nan=-100.0), 1)
        rays, other = self._rig.left_rays(points), self._rig.right_rays(found)
        away_px = (rays - other) * self._rig.focal_px
        # Epipolar gate: the same rectified row, and a positive disparity.
        self._off_px = away_px[is_good, 1]
        self._learn_row()
        is_good &= (np.abs(away_px[:, 1] - self._row_px) < _EPIPOLAR_MAX_PX) & (away_px[:, 0] > _DISPARITY_MIN_PX)
        found[~is_good] = np.nan
        return found

    def search(self, left: Picture, points: Pixels, right: Picture) -> Pixels:
        """A guess to a few pixels for points without one; not-a-number where it is ambiguous."""
        if len(points) == 0:
            return points
        small_left, small_right = self._small(left), self._small(right)
        count, steps = len(points), len(self._steps)
        rays = np.repeat(self._rig.left_rays(points), steps, axis=0)
        rays[:, 0] -= np.tile(self._steps, count)
        candidates = self._rig.right_pixels(rays).reshape(count, steps, 2)
        wanted, _ = _patches(small_left, points)
        there, is_inside = _patches(small_right, candidates)
        # Zero-mean normalized cross-correlation along the epipolar line; a near-equal second peak rejects.
        alike = np.where(is_inside, np.einsum("np,nsp->ns", wanted, there), -1.0)
        best = alike.argmax(axis=1)
        value = alike[np.arange(count), best]
        is_far = np.abs(np.arange(steps)[None] - best[:, None]) > 2
        second = np.where(is_far, alike, -1.0).max(axis=1)
        guess: Pixels = candidates[np.arange(count), best].astype(np.float32)
        guess[(value < _ALIKE_MIN) | (second > _SECOND_MAX * value)] = np.nan
        return guess

    def _small(self, picture: Picture) -> Picture:
        cv2 = self._cv2
        small: Picture = cv2.resize(picture, None, fx=1.0 / _COARSE, fy=1.0 / _COARSE, interpolation=cv2.INTER_AREA)
        return small


def _patches(small: Picture, places: Any) -> tuple[Any, Any]:
    """Patches around places of the full picture, (..., pixels), of mean 0 and length 1; and which are inside."""
    height, width = small.shape
    at = np.nan_to_num((places - (_COARSE - 1) / 2.0) / _COARSE, nan=-1.0)
    whole = np.rint(np.clip(at, -1e4, 1e4)).astype(np.intp)
    is_inside = (whole >= 0).all(axis=-1) & (whole[..., 0] < width) & (whole[..., 1] < height)
    steps = np.arange(-_REACH, _REACH + 1)
    columns = np.clip(whole[..., 0, None, None] + steps[None, :], 0, width - 1)
    rows = np.clip(whole[..., 1, None, None] + steps[:, None], 0, height - 1)
    patches = small[rows, columns].reshape(*places.shape[:-1], -1).astype(np.float32)
    patches -= patches.mean(axis=-1, keepdims=True)
    patches /= np.sqrt(np.sum(patches * patches, axis=-1, keepdims=True)) + 1e-3
    return patches, is_inside
