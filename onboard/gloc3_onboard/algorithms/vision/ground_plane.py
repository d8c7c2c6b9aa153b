"""Robust fit of a camera's motion over a plane, and of the plane's slope, to points seen twice.

All lengths are in units of the camera's height above the plane at the key frame. Directions are *flat*, `(n, 2)`:
forward and right at one unit down, in level axes with the heading of the body (forward, right, down). The plane is
`down = 1 + slope . (forward, right)`.

The motion between two views of a plane is a homography; here it is parametrized by known quantities (attitude from the
inertial unit, previous slope), which enter as a prior (Hartley and Zisserman, *Multiple View Geometry*,
chapter 13; maximum a posteriori by Gauss and Newton, weights of Geman and McClure).
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_SCALES: Final = (6.0, 3.0, 2.0)
"""Half-weight distance of each round, in standard deviations: the basin first, then the precision."""
INLIER: Final = 3.5
"""Standard deviations within which a point is on the plane."""
_QUANTILE: Final = 0.3
"""Quantile for the scale estimate; more than half of the points may be off the plane."""
_SQUARE_AT_QUANTILE: Final = -2.0 * math.log(1.0 - _QUANTILE)
_WEAK: Final = 1e-4
"""Negligible prior information of the translation."""


class Prior(NamedTuple):
    """Prior knowledge of turn and slope."""

    turn: Array
    """Rotation `level_key_from_level_now`, (3, 3)."""
    turn_std_rad: Array
    """(3,), about forward, right and down."""
    slope: Array
    """(2,), rise of `down` per unit forward and right."""
    slope_std: float


class PlaneNoise(NamedTuple):
    """Bounds of a coordinate's standard deviation, in flat units."""

    least: float
    most: float

    def of(self, square: Array) -> float:
        """Deviation of one coordinate, from the squared distances (Rayleigh) of the better third."""
        rank = int(_QUANTILE * len(square))
        found = math.sqrt(float(np.partition(square, rank)[rank]) / _SQUARE_AT_QUANTILE)
        return min(max(found, self.least), self.most)


class PlaneMotion(NamedTuple):
    """Result of the fit."""

    translation: Array
    """Where the camera is now, (3,), in the key frame's level axes, in key heights."""
    turn: Array
    """Rotation `level_key_from_level_now`, (3, 3)."""
    slope: Array
    """(2,)."""
    covariance: Array
    """(8, 8): translation, turn (a rotation vector in the current axes), slope."""
    residuals: Array
    """Distance of each point from where it should be, (n,), in flat units."""
    is_inlier: Flags
    """Whether each point is on the plane, (n,)."""
    noise: float
    """Standard deviation of one coordinate of the inliers, in flat units."""

    @property
    def height_ratio(self) -> float:
        """The camera's vertical distance to the plane now, in key heights."""
        return float(1.0 + self.slope @ self.translation[:2] - self.translation[2])


def on_plane(flat: Array, depth: Array, slope: Array) -> Array:
    """Points (n, 3) where directions meet the plane, at a share `depth` (n,) of the distance."""
    reach = depth / (1.0 - flat @ slope)
    return np.column_stack((flat * reach[:, None], reach))


def appear(points: Array, translation: Array, turn: Array) -> Array:
    """Flat directions (n, 2) of points (n, 3) from another place; not-a-number for those not below it."""
    seen = (points - translation) @ turn
    down = np.where(seen[:, 2] > 1e-3, seen[:, 2], np.nan)
    return np.asarray(seen[:, :2] / down[:, None])


def fit(before: Array, now: Array, depth: Array, prior: Prior, translation: Array, noise: PlaneNoise) -> PlaneMotion:
    """Fits the motion to points seen twice.

    Args:
        before: Flat directions at the key frame, (n, 2).
        now: The same points in the current picture, (n, 2).
        depth: Depth of each point as a share of the distance to the plane, (n,); 1 on the plane.
        prior: Prior knowledge.
        translation: Initial value, (3,).
        noise: Bounds of the standard deviation of a coordinate.
    """
    turn, slope = prior.turn, prior.slope.copy()
    translation = translation.copy()
    for scale in _SCALES:
        residual, jacobian = _linearize(before, now, depth, translation, turn, slope)
        square = np.einsum("ij,ij->i", residual, residual)
        spread = noise.of(square)
        # Weights: Geman-McClure, 1 / (1 + r^2/c^2)^2; c shrinks from round to round.
        weight = 1.0 / (1.0 + square / (scale * spread * 1.5) ** 2) ** 2 / spread**2
        weight[~np.isfinite(weight)] = 0.0
        information, gradient = _normal_equations(residual, jacobian, weight, turn, slope, prior)
        # Gauss-Newton: (J^T W J + D) dx = J^T W r + D (prior - x), D the prior's information.
        step = np.asarray(np.linalg.solve(information, gradient))
        translation = translation + step[:3]
        turn = turn @ _turned(step[3:6])
        slope = slope + step[6:]
    residual, jacobian = _linearize(before, now, depth, translation, turn, slope)
    square = np.einsum("ij,ij->i", residual, residual)
    spread = noise.of(square)
    is_inlier = square < (INLIER * spread) ** 2
    information, _ = _normal_equations(residual, jacobian, is_inlier / spread**2, turn, slope, prior)
    # Covariance: inverse of the inliers' and the prior's information.
    covariance = np.asarray(np.linalg.inv(information))
    return PlaneMotion(translation, turn, slope, covariance, np.sqrt(square), is_inlier, spread)


def relief(before: Array, now: Array, motion: PlaneMotion) -> tuple[Array, Array, Array]:
    """Depth of each point from its motion, as a share of the distance to the plane.

    Returns:
        The shares (n,), their standard deviations (n,), and the residual distances of the points (n,), in
        flat units.
    """
    flat = on_plane(before, np.ones(len(before)), motion.slope) @ motion.turn
    origin = motion.translation @ motion.turn
    along = now * flat[:, 2:] - flat[:, :2]
    moved = now * origin[2] - origin[:2]
    # Triangulate: least squares for the depth share, (a . m) / (a . a).
    square = np.maximum(np.einsum("ij,ij->i", along, along), 1e-12)
    share = np.einsum("ij,ij->i", along, moved) / square
    down = np.maximum(np.abs(share * flat[:, 2] - origin[2]), 1e-3)
    left = np.linalg.norm(along * share[:, None] - moved, axis=1) / down
    return share, motion.noise * down / np.sqrt(square), left


def start(cv2: Any, before: Array, now: Array, depth: Array, prior: Prior, reach: float) -> Array | None:
    """A first translation (3,) by RANSAC, without a prediction; None where the points do not agree."""
    points = on_plane(before, depth, prior.slope)
    turned = points @ prior.turn
    # RANSAC: a similarity, whose scale is the change of height and whose shift the motion along the plane.
    found, _ = cv2.estimateAffinePartial2D(
        np.ascontiguousarray(turned[:, :2]),
        np.ascontiguousarray(now),
        method=cv2.RANSAC,
        ransacReprojThreshold=reach,
        maxIters=200,
        confidence=0.99,
    )
    if found is None:
        return None
    scale = float(np.hypot(found[0, 0], found[1, 0]))
    if not 0.2 < scale < 5.0:
        return None
    down = 1.0 / scale
    middle = float(np.median(depth))
    moved = -np.array([*(found[:, 2] * down), 0.0])
    translation: Array = prior.turn @ moved
    translation[2] = middle - down
    return translation


def _linearize(
    before: Array, now: Array, depth: Array, translation: Array, turn: Array, slope: Array
) -> tuple[Array, Array]:
    """What is not explained (n, 2), and its derivative (n, 2, 8) by translation, turn and slope."""
    lean = 1.0 / (1.0 - before @ slope)
    points = np.column_stack((before, np.ones(len(before)))) * (depth * lean)[:, None]
    seen = (points - translation) @ turn
    down = 1.0 / np.maximum(seen[:, 2], 1e-2)
    flat = seen[:, :2] * down[:, None]
    # d(seen): by translation -turn.T, by turn the cross product, by slope along the ray.
    change = np.empty((len(now), 3, 8))
    change[:, :, :3] = -turn.T
    x, y, z = seen.T
    change[:, 0, 3], change[:, 0, 4], change[:, 0, 5] = 0.0, -z, y
    change[:, 1, 3], change[:, 1, 4], change[:, 1, 5] = z, 0.0, -x
    change[:, 2, 3], change[:, 2, 4], change[:, 2, 5] = -y, x, 0.0
    ray = (points @ turn) * lean[:, None]
    change[:, :, 6:] = ray[:, :, None] * before[:, None, :]
    jacobian = (change[:, :2] - flat[:, :, None] * change[:, 2:]) * down[:, None, None]
    return now - flat, jacobian


def _normal_equations(
    residual: Array, jacobian: Array, weight: Array, turn: Array, slope: Array, prior: Prior
) -> tuple[Array, Array]:
    flat = jacobian.reshape(-1, 8)
    doubled = np.repeat(weight, 2)
    weighted = flat * doubled[:, None]
    information = flat.T @ weighted
    left = residual.reshape(-1)
    gradient = weighted.T @ np.where(doubled > 0.0, left, 0.0)
    diagonal = np.concatenate((np.full(3, _WEAK), prior.turn_std_rad**-2.0, np.full(2, prior.slope_std**-2.0)))
    information[np.diag_indices(8)] += diagonal
    away = np.concatenate((np.zeros(3), _rotation_vector(turn.T @ prior.turn), prior.slope - slope))
    return information, gradient + diagonal * away


def _rotation_vector(turn: Array) -> Array:
    """Of a small turn."""
    return 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])


def _turned(vector: Array) -> Array:
    """The turn by a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-9:
        return np.asarray(np.eye(3) + cross)
    return np.asarray(np.eye(3) + np.sin(angle) / angle * cross + (1.0 - np.cos(angle)) / angle**2 * (cross @ cross))
