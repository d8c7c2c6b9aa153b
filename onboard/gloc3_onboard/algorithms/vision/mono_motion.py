"""Monocular visual odometry: rotation and direction of motion from picture to picture, without scale."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gloc3.camera.geometry import Array, matrix, unproject
from gloc3.camera.model import CameraModel
from gloc3.camera.opencv import load_opencv
from gloc3_onboard.algorithms.vision.corners import GridCorners
from gloc3_onboard.algorithms.vision.lucas_kanade import PatchTracker
from gloc3_onboard.algorithms.vision.picture import LightEvener, Picture, problem
from gloc3_onboard.algorithms.vision.point_tracker import PointTracker
from gloc3_onboard.algorithms.vision.pose_fit import rotation_of

_LEVELS: Final = 4
_CELL_PX: Final = 32
_SEED: Final = 7
_FEW: Final = 20
_LEAST_SHARE: Final = 0.15
"""A car's pictures change much from one to the next."""
_INLIER_PX: Final = 0.7
_ROUNDS: Final = 8
_SCALE_PX: Final = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class MonoMotion:
    """Motion from one picture to the next."""

    t_s: float
    rotation: Array
    """The body's: before from now, (3, 3)."""
    direction: Array
    """Direction of motion in the axes of the first view, of length 1; meaningless at standstill."""
    is_valid: bool
    reason: str = ""
    points: int = 0


class MonoTracker:
    """Estimates rotation and direction from the pictures of one calibrated camera."""

    def __init__(self, camera: CameraModel) -> None:
        self._cv2 = load_opencv()
        self._camera = camera
        self._focal_px = float(np.mean(camera.focal_px))
        self._frd_from_rdf = matrix(camera.frd_from_rdf)
        self._light = LightEvener()
        self._points = PointTracker(GridCorners(_CELL_PX), PatchTracker(), _LEVELS, _LEAST_SHARE)
        self._t_s = -np.inf

    def update(self, picture: Picture, t_s: float) -> MonoMotion:
        """The motion since the picture before."""
        reason = problem(picture, self._camera)
        if reason or not t_s > self._t_s:
            return _none(t_s, reason or "the time does not grow")
        evened, points = self._light.even(picture), self._points
        before_ids, before_px = points.ids, points.pixels
        is_first = not points.has_anchor
        reason = "" if is_first else points.follow(evened, t_s - self._t_s)
        if reason:
            return _none(t_s, reason)
        points.accept()
        kept = np.isin(before_ids, points.ids, assume_unique=True)
        before, now = (unproject(self._camera, px.astype(np.float64)) for px in (before_px[kept], points.pixels))
        points.anchor(evened, points.candidates(evened))
        self._t_s = t_s
        if len(now) < _FEW:
            return _none(t_s, "the first picture" if is_first else f"only {len(now)} points are seen again")
        return self._motion(before, now, t_s)

    def _motion(self, before: Array, now: Array, t_s: float) -> MonoMotion:
        cv2, tight = self._cv2, _INLIER_PX / self._focal_px
        cv2.setRNGSeed(_SEED)
        # Essential matrix by MAGSAC++ (Barath et al., CVPR 2020); recoverPose picks the pose with points ahead.
        essential, is_inlier = cv2.findEssentialMat(now, before, np.eye(3), cv2.USAC_MAGSAC, 0.999, tight)
        if essential is None or essential.shape != (3, 3):
            return _none(t_s, "the points do not determine a motion")
        inlier = is_inlier.ravel() == 1
        _, rotation, direction, _ = cv2.recoverPose(essential, now[inlier], before[inlier], np.eye(3))
        rotation, direction = _refined(before, now, rotation, direction.ravel(), _SCALE_PX / self._focal_px)
        turn = self._frd_from_rdf
        return MonoMotion(
            t_s=t_s,
            rotation=turn @ rotation @ turn.T,
            direction=turn @ direction,
            is_valid=int(inlier.sum()) >= _FEW,
            reason="" if int(inlier.sum()) >= _FEW else "too few points agree on a motion",
            points=int(inlier.sum()),
        )


def _none(t_s: float, reason: str) -> MonoMotion:
    return MonoMotion(t_s=t_s, rotation=np.eye(3), direction=np.zeros(3), is_valid=False, reason=reason)


def _refined(before: Array, now: Array, rotation: Array, direction: Array, scale: float) -> tuple[Array, Array]:
    """Rotation and direction with the least epipolar error of all points (Sampson's), outliers losing their weight."""
    one, other = (np.column_stack([rays, np.ones(len(rays))]) for rays in (before, now))
    for _ in range(_ROUNDS):
        turned = other @ rotation.T
        normal = np.cross(np.broadcast_to(direction, turned.shape), turned)
        back = np.cross(one, np.broadcast_to(direction, one.shape)) @ rotation
        length = np.sqrt(normal[:, 0] ** 2 + normal[:, 1] ** 2 + back[:, 0] ** 2 + back[:, 1] ** 2) + 1e-12
        # Residual: Sampson's, x'^T E x over its gradient (Hartley and Zisserman 2004, eq. 11.9).
        error = np.sum(one * normal, axis=1) / length
        # one . (d x (R (v x other))) by v, and one . (b x turned) by b, for b on the two axes across the direction.
        by_turn = np.cross(other, back) / length[:, None]
        across = np.linalg.svd(direction[None])[2][1:]
        by_direction = np.cross(turned, one) @ across.T / length[:, None]
        slopes = np.column_stack([by_turn, by_direction])
        # Geman-McClure weights; Gauss-Newton in 5: rotation, and direction on the unit sphere.
        weight = (1.0 / (1.0 + (error / scale) ** 2)) ** 2
        normal_matrix = (slopes * weight[:, None]).T @ slopes + 1e-12 * np.eye(5)
        step = -np.linalg.solve(normal_matrix, slopes.T @ (weight * error))
        rotation = rotation @ rotation_of(step[:3])
        direction = direction + across.T @ step[3:]
        direction = direction / np.linalg.norm(direction)
    return rotation, direction
