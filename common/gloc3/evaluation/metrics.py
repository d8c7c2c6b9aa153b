"""Absolute and relative trajectory error, defined as in the tool evo.

Sturm, Engelhard, Endres, Burgard and Cremers (IROS 2012) define both; the alignment is Umeyama's (PAMI 13, 1991).
"""

from enum import StrEnum
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gloc3.errors import Refused
from gloc3.evaluation.trajectory import Array, Trajectory

BEGIN_SHARE: Final = 0.1
"""Share of the poses that `TrajectoryAlignment.BEGIN` uses."""

TOLERANCE: Final = 0.1
"""Tolerance on the length of a stretch of the relative error, as a share of the requested length."""

LEAST_SIZE_M: Final = 0.05
LEAST_WIDTH: Final = 0.02
"""Smallest ratio of lateral to longitudinal spread of positions from which a rotation between frames can be
estimated."""

MATCH_S: Final = 0.01
"""Farthest apart in time that an estimate and the truth belong together."""


class TrajectoryAlignment(StrEnum):
    """Alignment of the estimate's frame with that of the truth; never of its scale."""

    BEGIN = "begin"
    """By the positions of the first tenth of the poses."""
    ALL = "all"
    """By all positions; hides drift."""
    ORIGIN = "origin"
    """By the first pose."""
    NONE = "none"
    """Not at all."""


class Statistics(msgspec.Struct, frozen=True, kw_only=True):
    """Of an error over all poses or pairs."""

    rms: float
    mean: float
    median: float
    max: float


class Evaluation(msgspec.Struct, frozen=True, kw_only=True):
    """Errors of an estimate against the truth."""

    poses: int
    """Poses of the estimate that the truth has a time for."""
    duration_s: float
    path_m: float
    """Length of the true path."""
    absolute_m: Statistics
    """ATE: distance from the true position."""
    absolute_deg: Statistics
    """Angle to the true attitude."""
    end_m: float
    """Distance from the true position at the end."""
    relative_over_m: float
    relative_pairs: int
    """Stretches of that length; 0 where the path is too short for one."""
    relative_m: Statistics | None
    """RPE: error of the motion over such a stretch."""
    relative_deg: Statistics | None

    @property
    def absolute_share(self) -> float:
        """ATE over the length of the path; 0 for a path without length."""
        return self.absolute_m.rms / self.path_m if self.path_m > 0.0 else 0.0


def evaluate(
    estimate: Trajectory,
    truth: Trajectory,
    align: TrajectoryAlignment = TrajectoryAlignment.BEGIN,
    over_m: float = 10.0,
) -> Evaluation:
    """Compares a trajectory with the truth.

    Raises:
        Refused: they have no time in common, or the alignment is not defined.
    """
    estimate, truth = matched(estimate, truth)
    aligned = laid_over(estimate, truth, align)
    distances = np.linalg.norm(aligned.position_m - truth.position_m, axis=1)
    angles = _angles_deg(truth.world_from_body.transpose(0, 2, 1) @ aligned.world_from_body)
    relative_m, relative_deg = relative_errors(estimate, truth, stretches(estimate, over_m))
    path = truth.distances_m
    return Evaluation(
        poses=len(truth),
        duration_s=float(truth.t_s[-1] - truth.t_s[0]),
        path_m=float(path[-1]),
        absolute_m=_statistics(distances),
        absolute_deg=_statistics(angles),
        end_m=float(distances[-1]),
        relative_over_m=over_m,
        relative_pairs=len(relative_m),
        relative_m=_statistics(relative_m) if len(relative_m) else None,
        relative_deg=_statistics(relative_deg) if len(relative_deg) else None,
    )


def matched(estimate: Trajectory, truth: Trajectory) -> tuple[Trajectory, Trajectory]:
    """The poses of both at the same times: for each of the shorter one the nearest of the longer, at most 10 ms off.

    Raises:
        Refused: there are none.
    """
    is_swapped = len(truth) < len(estimate)
    short, long = (truth, estimate) if is_swapped else (estimate, truth)
    if len(short) == 0:
        raise Refused("there is no pose to compare")
    after = np.searchsorted(long.t_s, short.t_s).clip(1, max(1, len(long) - 1))
    before = after - 1
    after = after.clip(max=len(long) - 1)
    is_before = np.abs(short.t_s - long.t_s[before]) <= np.abs(long.t_s[after] - short.t_s)
    nearest = np.where(is_before, before, after)
    is_near = np.abs(long.t_s[nearest] - short.t_s) <= MATCH_S
    if not is_near.any():
        raise Refused("the trajectory and the truth have no times in common")
    short, long = short.select(np.flatnonzero(is_near)), long.select(nearest[is_near])
    return (long, short) if is_swapped else (short, long)


def names_a_frame(estimate: Trajectory, truth: Trajectory, align: TrajectoryAlignment) -> bool:
    """Whether the positions that an alignment goes by are enough for it: neither in one place nor along one line."""
    if align in (TrajectoryAlignment.NONE, TrajectoryAlignment.ORIGIN):
        return True
    _, truth = matched(estimate, truth)
    positions = truth.position_m[: _count(truth, align)]
    along, across, _ = np.linalg.svd(np.vstack([positions - positions.mean(axis=0), np.zeros((3, 3))]))[1]
    size_m = along / np.sqrt(len(positions))
    return bool(size_m > LEAST_SIZE_M and across > LEAST_WIDTH * along)


def _count(poses: Trajectory, align: TrajectoryAlignment) -> int:
    return len(poses) if align is TrajectoryAlignment.ALL else max(3, int(len(poses) * BEGIN_SHARE))


def laid_over(estimate: Trajectory, truth: Trajectory, align: TrajectoryAlignment) -> Trajectory:
    """The estimate in the frame of the truth; both have the same times.

    Raises:
        Refused: the positions that are to align it lie in one point or line.
    """
    if align is TrajectoryAlignment.NONE:
        return estimate
    if align is TrajectoryAlignment.ORIGIN:
        rotation: Array = truth.world_from_body[0] @ estimate.world_from_body[0].T
        return estimate.moved(rotation, truth.position_m[0] - rotation @ estimate.position_m[0])
    count = _count(estimate, align)
    rotation, shift = _umeyama(estimate.position_m[:count], truth.position_m[:count])
    return estimate.moved(rotation, shift)


def _umeyama(points: Array, onto: Array) -> tuple[Array, Array]:
    middle, onto_middle = points.mean(axis=0), onto.mean(axis=0)
    u, sizes, vt = np.linalg.svd((onto - onto_middle).T @ (points - middle) / len(points))
    if np.count_nonzero(sizes > np.finfo(np.float64).eps) < 2:
        raise Refused("the positions to align by lie in one point or on one line; align by the first pose (origin)")
    mirror = np.diag([1.0, 1.0, -1.0 if np.linalg.det(u) * np.linalg.det(vt) < 0.0 else 1.0])
    rotation: Array = u @ mirror @ vt
    return rotation, onto_middle - rotation @ middle


def stretches(trajectory: Trajectory, over_m: float) -> NDArray[np.intp]:
    """Pairs of poses, shape (n, 2), whose distance along the trajectory is nearest to `over_m`, from every pose on."""
    distances = trajectory.distances_m
    first = np.arange(len(distances) - 1)
    wanted = distances[:-1] + over_m
    after = np.searchsorted(distances, wanted).clip(max=len(distances) - 1)
    before = np.maximum(after - 1, first + 1)
    is_before = wanted - distances[before] <= np.abs(distances[after] - wanted)
    last = np.maximum(np.where(is_before, before, after), first + 1)
    # Where the vehicle stands still several poses are as near: the first of them counts.
    last = np.maximum(np.searchsorted(distances, distances[last]), first + 1)
    is_fit = np.abs(distances[last] - wanted) <= TOLERANCE * over_m
    return np.column_stack([first[is_fit], last[is_fit]])


def steps(trajectory: Trajectory, count: int = 1) -> NDArray[np.intp]:
    """Pairs of poses, shape (n, 2), that are `count` poses apart."""
    first = np.arange(max(0, len(trajectory) - count))
    return np.column_stack([first, first + count])


def relative_errors(estimate: Trajectory, truth: Trajectory, pairs: NDArray[np.intp]) -> tuple[Array, Array]:
    """Errors of the motions between pairs of poses, in metres and in degrees; both have the same times."""
    (turn, shift), (true_turn, true_shift) = _motions(estimate, pairs), _motions(truth, pairs)
    return (
        np.linalg.norm(shift - true_shift, axis=1),
        _angles_deg(true_turn.transpose(0, 2, 1) @ turn),
    )


def _motions(trajectory: Trajectory, pairs: NDArray[np.intp]) -> tuple[Array, Array]:
    first, last = pairs.T
    back = trajectory.world_from_body[first].transpose(0, 2, 1)
    shift = trajectory.position_m[last] - trajectory.position_m[first]
    return back @ trajectory.world_from_body[last], (back @ shift[:, :, None])[:, :, 0]


def _angles_deg(rotations: Array) -> Array:
    """Angles of rotation matrices; by sine and cosine, so that small ones are not lost."""
    r = rotations
    sine = 0.5 * np.linalg.norm(
        np.column_stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]]), axis=1
    )
    angles: Array = np.degrees(np.arctan2(sine, 0.5 * (np.trace(r, axis1=1, axis2=2) - 1.0)))
    return angles


def _statistics(errors: Array) -> Statistics:
    return Statistics(
        rms=float(np.sqrt(np.mean(errors**2))),
        mean=float(errors.mean()),
        median=float(np.median(errors)),
        max=float(errors.max()),
    )
