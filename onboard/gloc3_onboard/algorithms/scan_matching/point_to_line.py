"""Point-to-line alignment: rotates and shifts a scan onto the walls of a map.

Gauss-Newton on the distances across the walls (Censi, "An ICP variant using a point-to-line metric", ICRA 2008), with
neighbours looked up again in each step and less weight on far points (Cauchy's weights).
"""

from math import atan2, cos, hypot, pi, sin
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import wrap_pi
from gloc3_onboard.algorithms.scan_matching.correlative import PRIOR, SearchWindow, candidates
from gloc3_onboard.algorithms.scan_matching.local_map import LocalMap
from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar

SOLVED: Final = 6
"""Fewest points that are fitted."""
SUPPORT: Final = 3.0
"""Summed squared incidence of beams below which a direction is unconstrained…"""
SUPPORT_SHARE: Final = 0.01
"""…and the same as a share of all beams."""
TURN_SUPPORT_M2: Final = 0.75
"""Information on the heading below which it is unconstrained: that of three beams at half a metre from the centre."""
EXCESS: Final = 4.0
"""Factor of the information explained by noise of the normals, which is subtracted."""


class Information(NamedTuple):
    """The normal equations of a fit, and how far they can be trusted."""

    matrix: Array
    """3 by 3: north, east, heading; in the map's axes, heading about the scanner; for residuals of variance 1 m²."""
    known: Array
    """Orthonormal directions constrained by the fit, as columns; shape (3, k) with k of 0 to 3."""
    sigma_m: float
    """Standard deviation of the residuals."""

    @property
    def is_degenerate(self) -> bool:
        """Whether some direction is not observable."""
        return len(self.known.T) < 3

    def solve(self, gradient: Array) -> Array:
        """The Gauss-Newton step, within the observable directions."""
        if not self.is_degenerate:
            return np.asarray(np.linalg.solve(self.matrix, gradient), np.float64)
        known = self.known
        # Degenerate: V (V^T A V)^-1 V^T g, V the observable directions (cf. Zhang, Kaess, Singh, ICRA 2016).
        step: Array = known @ np.linalg.solve(known.T @ self.matrix @ known, known.T @ gradient)
        return step

    def known_part(self, step: Array) -> Array:
        """The part of a step along observable directions."""
        part: Array = self.known @ (self.known.T @ step)
        return part

    def covariance(self, unknown_variance: float) -> Array:
        """3 by 3 covariance of north, east and heading."""
        known = self.known
        # C = sigma^2 V (V^T A V)^-1 V^T, and a large variance along I - V V^T.
        inverse = known @ np.linalg.inv(known.T @ self.matrix @ known) @ known.T
        result: Array = unknown_variance * (np.eye(3) - known @ known.T) + inverse * self.sigma_m**2
        return result


NOTHING: Final = Information(np.zeros((3, 3)), np.zeros((3, 0)), 1.0)
"""Of a fit to nothing."""


def information_of(jacobian: Array, swings: Array, weights: Array, angle_std_rad: Array, sigma_m: float) -> Information:
    """Builds the normal equations of point-to-line distances.

    Args:
        jacobian: of the distance to the line: its normal, and by the heading; shape (n, 3).
        swings: the same jacobian, were each normal turned by a right angle: how it changes with the normal's direction.
        weights: of each point.
        angle_std_rad: how well the direction of each line is known.
        sigma_m: standard deviation of the distances.
    """
    # Information J^T W J; `sure` is without what uncertain normals alone may have brought.
    matrix = jacobian.T @ (jacobian * weights[:, None])
    doubts = EXCESS * weights * angle_std_rad * angle_std_rad
    sure = matrix - swings.T @ (swings * doubts[:, None])
    (nn, ne, nh), (_, ee, eh), (_, _, hh) = sure.tolist()
    turning = max(float(matrix[2, 2]), 1e-9)
    needed = max(SUPPORT, SUPPORT_SHARE * float(weights.sum()))
    # Observability: eigenvalues of the position block, the heading eliminated (Schur complement).
    columns = [
        (n, e, 0.0)
        for value, n, e in _axes(nn - nh * nh / turning, ne - nh * eh / turning, ee - eh * eh / turning)
        if value >= needed
    ]
    if _turning_alone(nn, ne, ee, nh, eh, hh, columns) >= TURN_SUPPORT_M2:
        columns.append((0.0, 0.0, 1.0))
    return Information(matrix, np.array(columns).reshape(-1, 3).T, sigma_m)


def _axes(a: float, b: float, d: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Eigenvalues and unit eigenvectors of a symmetric 2 by 2 matrix, the larger first."""
    angle = 0.5 * atan2(2.0 * b, a - d)
    c, s = cos(angle), sin(angle)
    middle, spread = 0.5 * (a + d), hypot(0.5 * (a - d), b)
    return (middle + spread, c, s), (middle - spread, -s, c)


def _turning_alone(
    nn: float, ne: float, ee: float, nh: float, eh: float, hh: float, columns: list[tuple[float, float, float]]
) -> float:
    """Information on the heading when the position is free along the constrained directions."""
    if len(columns) == 2:
        return hh - (ee * nh * nh - 2.0 * ne * nh * eh + nn * eh * eh) / (nn * ee - ne * ne)
    if len(columns) == 1:
        n, e, _ = columns[0]
        return hh - (n * nh + e * eh) ** 2 / (n * n * nn + 2.0 * n * e * ne + e * e * ee)
    return hh


SIGHT_BINS: Final = 180
"""Directions in which a scan is compared with the map, all around."""
SIGHT_M: Final = 0.3
SIGHT_SHARE: Final = 0.05
"""A wall that is so much nearer than what the scan has hit there is seen through."""
STEPS: Final = 20
STILL_M: Final = 5e-4
STILL_RAD: Final = 2e-4
FIT_M: Final = 0.04
"""Distance from its wall within which a point fits, m."""
NEAR_M: Final = 0.15
"""Final search radius for neighbours, m."""
COARSE_M: Final = 0.4
FEW: Final = 120
TRIAL_STEPS: Final = 3
"""Candidates of the coarse search are tried with fewer points and steps."""
CLEAR: Final = 0.6
"""Where so much of a scan fits as expected, no other place is tried."""
BETTER: Final = 0.1
"""Margin in fitting share by which an unexpected place must be better; within it, places are about as good."""
CERTAIN_M: Final = 0.5
CERTAIN_RAD: Final = 0.5
"""In larger windows others are always tried: in rooms that repeat themselves, the expected place fits too."""
MOST_PLACES: Final = 3
SAME_M: Final = 0.15
SAME_RAD: Final = 0.1
"""Places of one scan that are no farther apart are the same."""
CLEARLY: Final = 0.08
"""Margin in fitting share that a search result needs along weakly constrained directions."""
SPREAD: Final = 1.5
"""Standard deviation over median of the sizes, for a normal distribution, rounded up."""
FINEST_M: Final = 0.005
"""No scanner is taken for better than this."""


class ScanAlignment(NamedTuple):
    """Pose of a scan in a map, and how well it fits."""

    pose: Planar
    information: Information
    share: float
    """Share of points on a wall."""
    residual_m: float
    """Robust standard deviation of the points on walls."""
    contradicted: float = 0.0
    """Share of the map's points in view through which the scan sees."""
    surprise: float = 0.0
    """What counts against it because it is not where it was expected."""

    @property
    def score(self) -> float:
        """How well the place explains the scan, at most 1."""
        return self.share * (1.0 - self.contradicted) ** 2 - self.surprise

    @property
    def is_doubtful(self) -> bool:
        """Whether another place might fit better."""
        return self.share < CLEAR or self.information.is_degenerate

    def without_prediction(self, guess: Planar) -> Planar:
        """The pose, with the guess along unobservable directions."""
        north, east, turn = self.pose.x_m - guess.x_m, self.pose.y_m - guess.y_m, self.pose.yaw_rad - guess.yaw_rad
        north, east, turn = self.information.known_part(np.array((north, east, wrap_pi(turn)))).tolist()
        return Planar(guess.x_m + north, guess.y_m + east, wrap_pi(guess.yaw_rad + turn))


def align(points: Array, walls: LocalMap, guess: Planar, within_m: float, steps: int = STEPS) -> ScanAlignment:
    """Aligns points to a map, point to line.

    Args:
        points: points of the scan; shape (n, 2).
        walls: the map.
        guess: approximate pose of the scan.
        within_m: initial search radius for walls.
        steps: largest number of steps.
    """
    pose, reach_m = guess, within_m
    found = ScanAlignment(pose, NOTHING, 0.0, 0.0)
    for _ in range(steps):
        # Correspondences: nearest point of the map within reach, looked up in each step.
        turned = points @ pose.rotation().T
        here = np.array((pose.x_m, pose.y_m))
        near = walls.neighbours(turned + here, reach_m)
        is_near = near.distance_m < np.inf
        if np.count_nonzero(is_near) < SOLVED:
            return ScanAlignment(pose, NOTHING, 0.0, 0.0)
        turned, n = turned[is_near], near.normals[is_near]
        # Residual: n . (R p + t - foot), the distance across the wall (Censi 2008).
        off = np.einsum("ij,ij->i", n, turned + here - near.feet_m[is_near])
        size = np.abs(off)
        # Weights: Cauchy, 1 / (1 + (r / 2 sigma)^2), sigma from the median of |r|.
        sigma = max(SPREAD * _median(size), FINEST_M)
        weights = 1.0 / (1.0 + (off / (2.0 * sigma)) ** 2)
        jacobian, swings = _jacobians(turned, n)
        known = information_of(jacobian, swings, weights, near.angle_std_rad[is_near], sigma)
        # Gauss-Newton: (J^T W J) dx = -J^T W r.
        north, east, turn = known.solve(-jacobian.T @ (weights * off)).tolist()
        pose = Planar(pose.x_m + north, pose.y_m + east, wrap_pi(pose.yaw_rad + turn))
        found = ScanAlignment(pose, known, float(np.count_nonzero(size < FIT_M)) / len(points), sigma)
        if reach_m <= NEAR_M and abs(north) + abs(east) < STILL_M and abs(turn) < STILL_RAD:
            break
        reach_m = max(0.6 * reach_m, NEAR_M)
    return found


def search(
    points: Array,
    walls: LocalMap,
    guess: Planar,
    window: SearchWindow,
    clear: float = CLEAR,
    prior: float = PRIOR,
) -> list[ScanAlignment]:
    """Aligns points to a map from a guess that may be far off.

    Args:
        points: of the scan; shape (n, 2).
        walls: the map.
        guess: where the scan was taken, about.
        window: how wrong that may be.
        clear: where so much of the scan fits as expected, no other place is tried.
        prior: what a place at the edge of the window must fit better than one in its middle, as a share of the points.

    Returns:
        The best place, and others that explain the scan about as well.
    """
    few = points[:: max(1, len(points) // FEW)]
    sight = ScanSight(points)

    def judged(found: ScanAlignment) -> ScanAlignment:
        off = guess.inverse() @ found.pose
        away, turned = off.distance_m / window.distance_m, abs(off.yaw_rad) / window.heading_rad
        surprise = prior * (min(away, 1.0) ** 2 + min(turned, 1.0) ** 2)
        return found._replace(contradicted=sight.contradicted(found.pose, walls), surprise=surprise)

    # Coarse: short fits from the guess, then from the correlative candidates; fine: full fits of the best.
    trials = [judged(align(few, walls, guess, COARSE_M, steps=TRIAL_STEPS))]
    if (
        trials[0].is_doubtful
        or trials[0].share < clear
        or window.distance_m > CERTAIN_M
        or window.heading_rad > CERTAIN_RAD
    ):
        begins = candidates(points, walls.feet_m, guess, window, prior)
        trials += [judged(align(few, walls, begin, COARSE_M, steps=TRIAL_STEPS)) for begin in begins]
    best = _best(trials)
    close = [
        trial
        for trial in trials
        if trial.score > best.score - 2.0 * BETTER and not is_same_place(trial.pose, best.pose)
    ]
    found = [judged(_refined(points, walls, trial.pose, guess)) for trial in (best, *close[: MOST_PLACES - 1])]
    best = _best(found)
    distinct = [best]
    for place in found:
        if place.score > best.score - BETTER and not any(is_same_place(place.pose, one.pose) for one in distinct):
            distinct.append(place)
    return distinct


class ScanSight:
    """How far a scan sees in each direction.

    Args:
        points_m: of the scan, shape (n, 2).
    """

    def __init__(self, points_m: Array) -> None:
        nearest = np.full(SIGHT_BINS, np.inf)
        np.minimum.at(nearest, _bins(points_m), np.hypot(*points_m.T))
        farther = np.maximum(np.roll(nearest, 1), np.roll(nearest, -1))
        self._nearest_m = np.minimum(nearest, np.minimum(np.roll(nearest, 1), np.roll(nearest, -1)))
        """What is hit in a direction or the ones beside it; infinite where nothing is."""
        self._nearest_m[np.isinf(nearest) | np.isinf(farther)] = 0.0

    def contradicted(self, pose: Planar, walls: LocalMap) -> float:
        """Share of the walls in view through which the scan would see from a pose."""
        feet = pose.inverse().apply(walls.feet_m)
        away_m = np.hypot(*feet.T)
        seen_m = self._nearest_m[_bins(feet)]
        slack_m = SIGHT_M + SIGHT_SHARE * away_m
        through, hit = np.count_nonzero(seen_m > away_m + slack_m), np.count_nonzero(np.abs(seen_m - away_m) <= slack_m)
        return float(through) / max(float(through + hit), 1.0)


def _bins(points_m: Array) -> NDArray[np.intp]:
    turns = np.arctan2(points_m[:, 1], points_m[:, 0]) * (SIGHT_BINS / (2.0 * pi))
    bins: NDArray[np.intp] = np.floor(turns).astype(np.intp) % SIGHT_BINS
    return bins


def _best(places: list[ScanAlignment]) -> ScanAlignment:
    """The best of some places; another than the first must be clearly better than one that fits well."""
    best = places[0]
    for place in places[1:]:
        best = place if place.score > best.score + (CLEARLY if best.share > CLEAR else 0.0) else best
    return best


def is_same_place(one: Planar, other: Planar) -> bool:
    """Whether two poses are one, for two fits of a scan."""
    off = one.inverse() @ other
    return off.distance_m < SAME_M and abs(off.yaw_rad) < SAME_RAD


def _refined(points: Array, walls: LocalMap, place: Planar, guess: Planar) -> ScanAlignment:
    found = align(points, walls, place, 2.0 * NEAR_M)
    if not found.information.is_degenerate:
        return found
    # Along what the walls do not tell, a search finds something at random, unless much more of the scan fits there.
    expected = align(points, walls, found.without_prediction(guess), NEAR_M)
    return found if found.share > expected.share + CLEARLY else expected


def _jacobians(points: Array, normals: Array) -> tuple[Array, Array]:
    """Of the distances across the lines, by north, east and heading; and the same along the lines."""
    px, py, nx, ny = *points.T, *normals.T
    # dr/d(north, east, heading) = (n, n . (e_down x R p)); the other for n turned by a right angle.
    return np.column_stack((nx, ny, ny * px - nx * py)), np.column_stack((-ny, nx, nx * px + ny * py))


def _median(values: Array) -> float:
    """Much faster than `np.median` for some hundred values."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])
