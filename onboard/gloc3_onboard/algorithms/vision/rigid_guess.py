"""Expected places of tracked points in the next pair of pictures, by the rigid motion of the pair of cameras."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.geometry import Array
from gloc3.camera.opencv import load_opencv
from gloc3_onboard.algorithms.odometry.gyro_turn import InertialTurn
from gloc3_onboard.algorithms.vision.corners import Pixels
from gloc3_onboard.algorithms.vision.picture import Picture
from gloc3_onboard.algorithms.vision.pose_fit import (
    Points,
    PoseFitNoise,
    fit_pose,
    pose_by_three_points,
    rotation_of,
    vector_of,
)
from gloc3_onboard.algorithms.vision.stereo_rig import StereoRig

_RAY_PX: Final = 0.3
_DISPARITY_PX: Final = 0.4
_LEAST_POINTS: Final = 8
_LEAST_SHARE: Final = 0.5
_CORNERS: Final = 1500
_EDGE_PX: Final = 16
_PATCH_PX: Final = 31
_FAR: Final = 64.0
"""Of 256 bits, from which on two patches are different."""
_RATIO: Final = 0.85
_SIZES: Final = (1.0, 1.3, 1.7)
"""In which the points are looked for: a camera that drives ahead sees them grow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RigidMotion:
    """Motion of the left camera from one view to the next, in rectified axes."""

    position_m: Array
    rotation: Array
    """First from second, (3, 3)."""


class RigidGuess:
    """Learns the motion between the last two pairs, and where it leads the points next.

    Args:
        rig: the calibrated pair.
    """

    def __init__(self, rig: StereoRig) -> None:
        self._rig = rig
        self._noise = PoseFitNoise(ray=_RAY_PX / rig.focal_px, disparity=_DISPARITY_PX / rig.focal_px)
        self.reset()

    def reset(self) -> None:
        """Drops both pairs."""
        self._pairs: list[tuple[float, NDArray[np.int32], Array]] = []
        self._motion: RigidMotion | None = None

    def learn(self, t_s: float, ids: NDArray[np.int32], pixels: Pixels, right_pixels: Pixels) -> None:
        """Takes in the points of one more pair: ids in growing order, places (n, 2), right ones not-a-number if unknown."""
        rays, other = self._rig.left_rays(pixels), self._rig.right_rays(right_pixels)
        seen = np.column_stack([rays, rays[:, 0] - other[:, 0]])
        self._pairs = [*self._pairs[-1:], (t_s, ids, seen)]
        self._motion = None

    def ahead(self, t_s: float, turn: InertialTurn | None = None) -> RigidMotion | None:
        """The motion from the last pair to a time, if the last motion goes on; None without one.

        Args:
            t_s: when.
            turn: of the body by gyros in this time, instead of the last motion's.
        """
        if self._motion is None and len(self._pairs) == 2:
            self._motion = self._last()
        if self._motion is None:
            return None
        (first_s, _, _), (last_s, _, _) = self._pairs
        times = (t_s - last_s) / (last_s - first_s)
        axes = self._rig.frd_from_rectified
        rotation = (
            rotation_of(times * vector_of(self._motion.rotation)) if turn is None else axes.T @ turn.rotation @ axes
        )
        return RigidMotion(position_m=times * self._motion.position_m, rotation=rotation)

    def _last(self) -> RigidMotion | None:
        (_, before_ids, before), (_, now_ids, now) = self._pairs
        _, of_before, of_now = np.intersect1d(before_ids, now_ids, assume_unique=True, return_indices=True)
        is_placed = np.isfinite(before[of_before, 2])
        points = self._points(before[of_before[is_placed]], now[of_now[is_placed]])
        if len(points.rays) < _LEAST_POINTS:
            return None
        fit = fit_pose(points, self._rig.baseline_m, self._noise, np.zeros(3), np.eye(3))
        if fit is None or fit.is_inlier.mean() < _LEAST_SHARE:
            return None
        return RigidMotion(position_m=fit.position_m, rotation=fit.rotation)

    def _points(self, before: Array, now: Array) -> Points:
        base = self._rig.baseline_m
        variance = np.full(len(before), (self._noise.disparity / base) ** 2)
        inverse_m = np.maximum(before[:, 2] / base, 1e-4)
        return Points(rays=before[:, :2], inverse_m=inverse_m, inverse_variance=variance, seen=now)

    def by_matches(self, which: NDArray[np.intp], pixels: Pixels) -> RigidMotion | None:
        """The motion from the last pair by doubtful matches of some of its points; None if they agree on none.

        Args:
            which: points of the last pair, (m,).
            pixels: where they seem to be now, (m, 2).
        """
        before = self._pairs[-1][2][which]
        is_placed = np.isfinite(before[:, 2])
        rays = self._rig.left_rays(pixels[is_placed])
        now = np.column_stack([rays, np.full(len(rays), np.nan)])
        points = self._points(before[is_placed], now)
        if len(rays) < _LEAST_POINTS:
            return None
        start = pose_by_three_points(points, 3.0 / self._rig.focal_px)
        return None if start is None else RigidMotion(position_m=start[0], rotation=start[1])

    def places(self, motion: RigidMotion) -> tuple[Pixels, Pixels]:
        """Where the last pair's points are after a motion, (n, 2), and how much larger they appear, (n,).

        Not-a-number for those behind the camera.
        """
        seen = self._pairs[-1][2]
        inverse_m = np.maximum(seen[:, 2] / self._rig.baseline_m, 1e-4)
        known = np.isfinite(inverse_m)
        inverse_m = np.where(known, inverse_m, np.median(inverse_m[known]) if known.any() else 1e-4)
        ray3 = np.column_stack([seen[:, :2], np.ones(len(seen))])
        ahead = (ray3 - inverse_m[:, None] * motion.position_m) @ motion.rotation
        depth = np.where(ahead[:, 2] > 0.1, ahead[:, 2], np.nan)
        pixels: Pixels = self._rig.left_pixels(ahead[:, :2] / depth[:, None]).astype(np.float32)
        return pixels, (1.0 / depth).astype(np.float32)


def match_patches(of: Picture, points: Pixels, into: Picture) -> tuple[NDArray[np.intp], Pixels]:
    """Matches points with corners anywhere in another picture, by descriptors (Rublee et al., ORB, ICCV 2011).

    Returns:
        Which points have a match, (m,), and where those are, (m, 2).
    """
    cv2 = load_opencv()
    none = np.zeros(0, np.intp), np.zeros((0, 2), np.float32)
    describer = cv2.ORB_create(edgeThreshold=_EDGE_PX, patchSize=_PATCH_PX)
    small = cv2.resize(into, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    corners = cv2.goodFeaturesToTrack(small, _CORNERS, 0.002, 3.0)
    if corners is None:
        return none
    _, there_px, wanted = _described(describer, into, corners[:, 0] * 2.0 + 0.5)
    if len(wanted) < 2:
        return none
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
    best = np.full(len(points), _FAR)
    places = np.zeros((len(points), 2), np.float32)
    for size in _SIZES:
        resized = of if size == 1.0 else cv2.resize(of, None, fx=size, fy=size, interpolation=cv2.INTER_LINEAR)
        which, _, described = _described(describer, resized, points * size + (size - 1.0) / 2.0)
        for pair in matcher.knnMatch(described, wanted, k=2) if len(described) else ():
            first, second = pair
            point = which[first.queryIdx]
            if first.distance < _RATIO * second.distance and first.distance < best[point]:
                best[point], places[point] = first.distance, there_px[first.trainIdx]
    found = np.flatnonzero(best < _FAR)
    return found, places[found]


def _described(describer: Any, picture: Picture, points: Pixels) -> tuple[NDArray[np.intp], Pixels, Any]:
    """Descriptors of points, upright: which ones have one, where those are, and the descriptors."""
    cv2 = load_opencv()
    keys = [cv2.KeyPoint(float(x), float(y), _PATCH_PX, 0.0, 0.0, 0, n) for n, (x, y) in enumerate(points)]
    kept, found = describer.compute(picture, keys)
    which = np.array([key.class_id for key in kept], np.intp)
    return which, points[which].astype(np.float32), found if found is not None else np.zeros((0, 32), np.uint8)
