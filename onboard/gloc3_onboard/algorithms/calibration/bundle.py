"""Joint least squares of cameras, their places and the boards' poses, with the covariance of what is found.

The projections and their derivatives are OpenCV's; the minimization is MINPACK's, by scipy.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from gloc3.camera.model import Lens
from gloc3.camera.opencv import load_opencv
from gloc3_onboard.algorithms.calibration.boards import BoardView, Floats

COEFFICIENTS: Final[dict[Lens, int]] = {Lens.PINHOLE: 0, Lens.RADTAN: 4, Lens.EQUIDISTANT: 4}
POSE: Final = 6
MOST_ROUNDS: Final = 100


class Sighting(NamedTuple):
    """A board as one camera has seen it at one moment."""

    camera: int
    moment: int
    """Number of the pose of the board."""
    view: BoardView


class CameraRig(NamedTuple):
    """Unknowns of cameras that look at a board: all that the least squares change."""

    lens: Lens
    intrinsics: Floats
    """Row a camera: two focal lengths, column and row of the axis, coefficients."""
    places: Floats
    """Row a camera: rotation vector and translation of `camera_from_first`; the first row is 0."""
    poses: Floats
    """Row a moment: rotation vector and translation of `first_from_board`."""


class Solution(NamedTuple):
    """A rig that fits best, and how well."""

    rig: CameraRig
    residuals_px: tuple[Floats, ...]
    """What each sighting lacks: (n, 2), found less predicted."""
    intrinsics_cov: Floats
    """Covariance of the intrinsics, (cameras, k, k)."""
    places_cov: Floats
    """Covariance of the places, (cameras, 6, 6)."""

    @property
    def rms_px(self) -> float:
        """Root mean square of the distances."""
        return float(np.sqrt(np.mean(np.concatenate([(each**2).sum(axis=1) for each in self.residuals_px]))))


def project(lens: Lens, points_m: Floats, pose: Floats, intrinsics: Floats) -> tuple[Floats, Floats]:
    """Columns and rows of points on a board, (n, 2), and their derivatives by pose and intrinsics, (2 n, 6 + k)."""
    cv2 = load_opencv()
    fx, fy, cx, cy, *coefficients = intrinsics.tolist()
    k, turn, shift = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), pose[:3], pose[3:]
    if lens is Lens.EQUIDISTANT:
        pixels, slope = cv2.fisheye.projectPoints(
            points_m.reshape(-1, 1, 3), turn.reshape(3, 1), shift.reshape(3, 1), k, np.array(coefficients)
        )
        order = [*range(8, 14), *range(8)]
    else:
        pixels, slope = cv2.projectPoints(points_m, turn, shift, k, np.array([*coefficients, *[0.0] * 5][:5]))
        order = [*range(10 + len(coefficients))]
    return pixels.reshape(-1, 2), slope[:, order]


def solve(sightings: Sequence[Sighting], begin: CameraRig) -> Solution:
    """The rig that makes the sum of squared distances least, from a begin that is near.

    The covariance is the larger of two, parameter by parameter: that of independent errors of the corners, and that of errors
    which the corners of a moment share (the jackknife by moments, as CR3 in Cameron and Miller, 2015).
    """
    from scipy.optimize import least_squares

    shape = _Shape(begin)
    found = least_squares(
        lambda x: shape.residuals(sightings, x),
        shape.pack(begin),
        jac=lambda x: shape.jacobian(sightings, x),
        method="lm",
        x_scale="jac",
        max_nfev=MOST_ROUNDS,
    )
    rig, residuals = shape.unpack(found.x), found.fun
    pieces = np.cumsum([2 * len(sighting.view.pixels) for sighting in sightings])[:-1]
    parts = tuple(part.reshape(-1, 2) for part in np.split(residuals, pieces))
    cov = _covariance(sightings, found.jac, residuals, shape)
    k, count = begin.intrinsics.shape[1], len(begin.intrinsics)
    own = np.array([cov[n * k : (n + 1) * k, n * k : (n + 1) * k] for n in range(count)])
    places = np.zeros((count, POSE, POSE))
    for camera in range(1, count):
        at = shape.place_at(camera)
        places[camera] = cov[at : at + POSE, at : at + POSE]
    return Solution(rig, parts, own, places)


def _covariance(sightings: Sequence[Sighting], jacobian: Floats, residuals: Floats, shape: "_Shape") -> Floats:
    """Covariance of what all moments share: intrinsics and places."""
    shared = shape.pose_at(0)
    scale = np.linalg.norm(jacobian[:, :shared], axis=0)
    slopes, scores = [], []
    moments = np.repeat([each.moment for each in sightings], [2 * len(each.view.pixels) for each in sightings])
    for moment in range(shape.moments):
        rows = moments == moment
        at = shape.pose_at(moment)
        base, _ = np.linalg.qr(jacobian[rows, at : at + POSE])
        free = jacobian[rows, :shared] / scale
        free -= base @ (base.T @ free)  # the pose of this moment takes its part of every change
        slopes.append(free.T @ free)
        scores.append(free.T @ residuals[rows])
    inverse = np.linalg.pinv(np.sum(slopes, axis=0))
    plain = inverse * float(residuals @ residuals) / max(len(residuals) - jacobian.shape[1], 1)
    one = np.eye(shared)
    steps = [np.linalg.pinv(one - slope @ inverse) @ score for slope, score in zip(slopes, scores, strict=True)]
    jackknife = inverse @ (np.transpose(steps) @ np.array(steps)) @ inverse * (len(steps) - 1) / len(steps)
    growth = np.sqrt(np.maximum(1.0, np.diag(jackknife) / np.maximum(np.diag(plain), 1e-300))) / scale
    return np.asarray(plain * np.outer(growth, growth))


class _Shape:
    """Order of the unknowns in one vector: intrinsics of all cameras, places of all but the first, poses."""

    def __init__(self, rig: CameraRig) -> None:
        self.lens, self.cameras, self.moments = rig.lens, len(rig.intrinsics), len(rig.poses)
        self.k: int = rig.intrinsics.shape[1]

    def place_at(self, camera: int) -> int:
        return self.cameras * self.k + (camera - 1) * POSE

    def pose_at(self, moment: int) -> int:
        return self.cameras * self.k + (self.cameras - 1 + moment) * POSE

    def pack(self, rig: CameraRig) -> Floats:
        return np.concatenate((rig.intrinsics.ravel(), rig.places[1:].ravel(), rig.poses.ravel()))

    def unpack(self, x: Floats) -> CameraRig:
        own, places, poses = np.split(x, [self.cameras * self.k, self.pose_at(0)])
        first = np.zeros((1, POSE))
        return CameraRig(
            self.lens,
            own.reshape(-1, self.k),
            np.concatenate((first, places.reshape(-1, POSE))),
            poses.reshape(-1, POSE),
        )

    def residuals(self, sightings: Sequence[Sighting], x: Floats) -> Floats:
        rig = self.unpack(x)
        return np.concatenate(
            [
                (
                    sighting.view.pixels
                    - project(
                        self.lens,
                        sighting.view.points_m,
                        then(rig.places[sighting.camera], rig.poses[sighting.moment]),
                        rig.intrinsics[sighting.camera],
                    )[0]
                ).ravel()
                for sighting in sightings
            ]
        )

    def jacobian(self, sightings: Sequence[Sighting], x: Floats) -> Floats:
        rig, blocks = self.unpack(x), []
        for camera, moment, view in sightings:
            pose, by_place, by_pose = _composed(rig.places[camera], rig.poses[moment])
            _, slope = project(self.lens, view.points_m, pose, rig.intrinsics[camera])
            block = np.zeros((len(slope), len(x)))
            block[:, camera * self.k : (camera + 1) * self.k] = -slope[:, POSE:]
            at = self.pose_at(moment)
            block[:, at : at + POSE] = -slope[:, :POSE] @ by_pose
            if camera:
                at = self.place_at(camera)
                block[:, at : at + POSE] = -slope[:, :POSE] @ by_place
            blocks.append(block)
        return np.concatenate(blocks)


def then(b_from_a: Floats, a_from_o: Floats) -> Floats:
    """`b_from_o` of two transforms, each a rotation vector and a translation."""
    if not b_from_a.any():
        return a_from_o
    return _composed(b_from_a, a_from_o)[0]


def inverse(b_from_a: Floats) -> Floats:
    """`a_from_b`."""
    turn, _ = load_opencv().Rodrigues(b_from_a[:3])
    return np.concatenate((-b_from_a[:3], -turn.T @ b_from_a[3:]))


def _composed(second: Floats, first: Floats) -> tuple[Floats, Floats, Floats]:
    """A transform after another, and its derivatives by the second and by the first."""
    if not second.any():
        return first, np.eye(POSE), np.eye(POSE)
    r, t, rr1, rt1, rr2, rt2, tr1, tt1, tr2, tt2 = load_opencv().composeRT(first[:3], first[3:], second[:3], second[3:])
    return (
        np.concatenate((r.ravel(), t.ravel())),
        np.block([[rr2, rt2], [tr2, tt2]]),
        np.block([[rr1, rt1], [tr1, tt1]]),
    )
