"""Motion of a stereo camera between two views of the same points: robust least squares, depths eliminated.

Points are rays and inverse depths in the first view. The second view measures ray and disparity; the first measured the
inverse depth, with its variance. Both poses and depths are estimated, the depths by the Schur complement, so that the
covariance of the pose includes the uncertainty of the depths. Outliers lose their weight by Geman and McClure's
function (Barron, CVPR 2019, for its place among others).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.geometry import Array
from gloc3.camera.opencv import load_opencv

_SEED: Final = 7
_ROUNDS: Final = 12
_STEP_MIN: Final = 1e-2
"""Of the estimate's own standard deviation, squared: a step that is less is the last one."""
_GATE: Final = 9.0
"""Squared normalized residual above which a measurement has little weight."""
_WIDE: Final = 4.0
"""The same in medians of all: a bad first guess must not make outliers of all points."""
_INLIER: Final = 11.3
"""99 % of the squared residuals of three measurements are below it."""
_MIDDLE: Final = 2.37
"""Half of the squared residuals of three measurements are below it."""
LARGEST_NOISE: Final = 16.0
"""Most that the measurements' variance may be larger than assumed."""
_OFFSET: Final = np.array([0.0, 0.0, 1.0])[:, None, None]
_BEHIND: Final = 0.05
"""Of a point's depth before: nearer than that share is held to be behind the camera."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Points:
    """Points of a first view, and their measurements in a second one. Rays are rectified, (n, 2)."""

    rays: Array
    inverse_m: Array
    """Inverse depths in the first view, (n,)."""
    inverse_variance: Array
    """Their variances, 1/m2."""
    seen: Array
    """In the second view: ray right, ray down, disparity, (n, 3); the disparity not-a-number where it has none."""
    offset_share: Array | None = None
    """How much of an offset of the disparities is in the inverse depths, 0 to 1, (n,); None for all of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseFitNoise:
    """Standard deviations of the measurements, in units of rays."""

    ray: float
    disparity: float
    offset: float = 0.0
    """Of an unknown constant in all disparities; 0 if there is none."""
    largest: float = LARGEST_NOISE
    """Most that the measurements' variance is held to be larger than by the above; 1 or more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseFit:
    """Pose of the second view in the axes of the first."""

    position_m: Array
    rotation: Array
    """First from second, (3, 3)."""
    covariance: Array
    """6 by 6: position in the first view's axes, then rotation vector in the second's."""
    is_inlier: NDArray[np.bool_]
    squares: Array
    """Squared residuals over their variance, (n,)."""
    noise: float
    """Variance of the measurements over the assumed one, by the residuals; 1 at least."""
    inverse_m: Array
    """Inverse depths in the first view, by both views."""
    inverse_variance: Array
    has_converged: bool
    offset: float = 0.0
    """The constant in all disparities that fits best, in units of rays."""
    offset_variance: float = 0.0


def fit_pose(
    points: Points, baseline_m: float, noise: PoseFitNoise, position_m: Array, rotation: Array
) -> PoseFit | None:
    """Fits a pose to points, from a first guess; None where the normal equations have no solution."""
    prior, variance = points.inverse_m, points.inverse_variance
    ray3 = np.column_stack([points.rays, np.ones(len(points.rays))])
    given = points.seen.T
    known = np.array([noise.ray**-2, noise.ray**-2, noise.disparity**-2])
    weights = np.where(np.isfinite(given), known[:, None], 0.0)
    given = np.nan_to_num(given)
    inverse, p, r = prior.copy(), position_m.copy(), rotation.copy()
    has_converged, offset = False, 0.0
    # With an offset e of the disparities, d = b w' + e: a seventh unknown, also in the depths that were triangulated.
    has_offset = noise.offset > 0.0
    in_depth = np.zeros(len(prior))
    if has_offset:
        in_depth = (1.0 if points.offset_share is None else points.offset_share) / baseline_m + in_depth
    for _ in range(_ROUNDS):
        residual, j_pose, j_depth, is_ahead = _linearize(ray3, inverse, baseline_m, p, r, given)
        if has_offset:
            residual[2] += offset
            j_pose = np.concatenate([j_pose, np.broadcast_to(_OFFSET, (3, len(ray3), 1))], axis=2)
        drift = inverse - prior + in_depth * offset
        squares = np.where(is_ahead, (weights * residual * residual).sum(axis=0) + drift * drift / variance, 1e6)
        gate = max(_GATE, _WIDE * float(np.median(squares)))
        # Geman-McClure weights (c / (c + r^2))^2, r^2 over the variance, the depth's own prior included.
        robust = (gate / (gate + squares)) ** 2
        w = weights * robust
        wj_depth = w * j_depth
        own = (wj_depth * j_depth).sum(axis=0) + robust / variance + 1e-12
        cross = (wj_depth[:, :, None] * j_pose).sum(axis=0)
        pull = (wj_depth * residual).sum(axis=0) + robust * drift / variance
        if has_offset:
            cross[:, 6] += robust / variance * in_depth
        unknowns = cross.shape[1]
        wj_pose = (w[:, :, None] * j_pose).reshape(-1, unknowns)
        # Schur complement: A - B D^-1 B^T, D the depths' diagonal block (Triggs et al., Bundle adjustment, 2000, 6.1).
        share = cross / own[:, None]
        information = j_pose.reshape(-1, unknowns).T @ wj_pose
        gradient = wj_pose.T @ residual.reshape(-1)
        if has_offset:
            information[6, 6] += (robust / variance) @ in_depth**2 + noise.offset**-2
            gradient[6] += (robust / variance * in_depth) @ drift + offset * noise.offset**-2
        information = information - share.T @ cross
        gradient = gradient - share.T @ pull
        inverted = _inverse(information)
        if inverted is None:
            return None
        covariance = inverted
        # Gauss-Newton step of the pose, then the depths by back-substitution.
        step = -(covariance @ gradient)
        inverse = np.maximum(inverse - (pull + cross @ step) / own, 1e-4)
        p = p + step[:3]
        r = _straight(r @ rotation_of(step[3:6]))
        offset += float(step[6]) if has_offset else 0.0
        # Converged: g^T A^-1 g, the squared step in its own standard deviations, is small.
        if -float(gradient @ step) < _STEP_MIN:
            has_converged = True
            break
    spread = float(np.clip(np.median(squares) / _MIDDLE, 1.0, noise.largest))
    return PoseFit(
        position_m=p,
        rotation=r,
        covariance=covariance[:6, :6],
        is_inlier=squares < _INLIER * spread,
        squares=squares,
        noise=spread,
        inverse_m=inverse,
        inverse_variance=1.0 / own + ((share @ covariance) * share).sum(axis=1),
        has_converged=has_converged,
        offset=offset,
        offset_variance=float(covariance[6, 6]) if has_offset else 0.0,
    )


def _linearize(
    ray3: Array, inverse: Array, baseline_m: float, p: Array, r: Array, given: Array
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Measured less expected values (3, n), their derivatives, and which points lie ahead.

    The derivatives are by the pose (3, n, 6) and by the inverse depth (3, n). Measured are ray right, ray down and
    disparity of the point in the second view; with q the point times its inverse depth, they are qx/qz, qy/qz, b/qz.
    """
    seen = (ray3 - inverse[:, None] * p) @ r
    is_ahead = seen[:, 2] > _BEHIND
    scale = 1.0 / np.where(is_ahead, seen[:, 2], 1.0)
    x, y = seen[:, 0] * scale, seen[:, 1] * scale
    disparity = (baseline_m * inverse) * scale
    measured = np.stack([x, y, disparity])
    j_pose = np.empty((3, len(ray3), 6))
    shift = (inverse * scale)[:, None]
    axis_x, axis_y, axis_z = -r.T
    along = measured[:, :, None] * axis_z
    j_pose[0, :, :3] = shift * (axis_x - along[0])
    j_pose[1, :, :3] = shift * (axis_y - along[1])
    j_pose[2, :, :3] = shift * -along[2]
    # A turn of the second view moves the point in it by the cross product of both.
    j_pose[0, :, 3], j_pose[0, :, 4], j_pose[0, :, 5] = x * y, -1.0 - x * x, y
    j_pose[1, :, 3], j_pose[1, :, 4], j_pose[1, :, 5] = 1.0 + y * y, -x * y, -x
    j_pose[2, :, 3], j_pose[2, :, 4], j_pose[2, :, 5] = disparity * y, -disparity * x, 0.0
    by_x, by_y, by_z = (-(p @ r)).tolist()
    j_depth: Array = np.stack([by_x - x * by_z, by_y - y * by_z, baseline_m - disparity * by_z]) * scale
    return measured - given, j_pose, j_depth, is_ahead


def rotation_of(vector_rad: Array) -> Array:
    """The matrix of a rotation vector (Rodrigues' formula)."""
    angle = float(np.sqrt(vector_rad @ vector_rad))
    x, y, z = vector_rad.tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-8:
        return np.asarray(np.eye(3) + cross)
    turned: Array = np.eye(3) + np.sin(angle) / angle * cross + (1.0 - np.cos(angle)) / angle**2 * (cross @ cross)
    return turned


def vector_of(rotation: Array) -> Array:
    """The rotation vector of a matrix, for angles well below half a turn."""
    sine = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    length = float(np.linalg.norm(sine)) / 2.0
    angle = float(np.arctan2(length, (np.trace(rotation) - 1.0) / 2.0))
    vector: Array = sine / 2.0 * (angle / length if length > 1e-9 else 1.0)
    return vector


def pose_by_three_points(points: Points, tolerance: float) -> tuple[Array, Array] | None:
    """A pose by three points at a time (Ke and Roumeliotis, CVPR 2017), for when there is no guess.

    Args:
        points: the points; their disparities in the second view are not used.
        tolerance: greatest error of an inlier, in units of rays.
    """
    cv2 = load_opencv()
    depth = 1.0 / points.inverse_m
    places = np.column_stack([points.rays * depth[:, None], depth])
    cv2.setRNGSeed(_SEED)
    is_found, turn, shift, _ = cv2.solvePnPRansac(
        places,
        np.ascontiguousarray(points.seen[:, :2]),
        np.eye(3),
        None,
        iterationsCount=300,
        reprojectionError=tolerance,
        flags=cv2.SOLVEPNP_AP3P,
    )
    if not is_found or not (np.isfinite(turn).all() and np.isfinite(shift).all()):
        return None
    rotation: Array = cv2.Rodrigues(turn)[0].T
    return -(rotation @ shift.ravel()), rotation


def _straight(rotation: Array) -> Array:
    """The matrix with its rounding errors, which would grow from product to product, taken out (a step of Newton's)."""
    straight: Array = 1.5 * rotation - 0.5 * rotation @ (rotation.T @ rotation)
    return straight


def _inverse(information: Array) -> Array | None:
    """The inverse of a symmetric matrix; None if it is not positive definite."""
    if not np.isfinite(information).all():
        return None
    try:
        back = np.linalg.inv(np.linalg.cholesky(information))
    except np.linalg.LinAlgError:
        return None
    inverse: Array = back.T @ back
    return inverse
