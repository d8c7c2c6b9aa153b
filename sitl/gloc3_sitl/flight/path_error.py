"""Path error of a flight against the requested path.

The error of a sample is the distance of the true position to the requested polyline at or after the progress already
made; progress may grow by at most `LOOK_AHEAD_M` (more for what turns wide) between two samples, so that a leg cannot be skipped unseen.
"""

import itertools
import math
from collections.abc import Sequence
from typing import Final

import msgspec

from gloc3.messages.frames import Vector3

LOOK_AHEAD_M: Final = 2.0
ROUNDING_M: Final = 0.05
"""Distance before a waypoint, along the path, at which it counts as reached, m."""
PASSED_M: Final = 0.3
"""A waypoint counts as passed within this distance."""


class TruthSample(msgspec.Struct, frozen=True):
    """True position of the vehicle at a time."""

    t_s: float
    position_ned_m: Vector3


class LegResult(msgspec.Struct, frozen=True):
    """One leg of the path as flown."""

    length_m: float
    duration_s: float
    mean_speed_m_s: float
    miss_m: float
    """Smallest distance to the waypoint at its end."""


class PathResult(msgspec.Struct, frozen=True):
    """The figures of one flight along one polyline."""

    rms_m: float
    max_m: float
    samples: int
    legs: list[LegResult]
    passed: int
    """Waypoints that were passed near enough, in their order, before the first that was not."""

    @property
    def is_complete(self) -> bool:
        """Whether every waypoint was passed in order."""
        return self.passed == len(self.legs)

    @property
    def slowest_m_s(self) -> float:
        """The smallest mean speed of any leg that was flown."""
        return min((leg.mean_speed_m_s for leg in self.legs), default=0.0)


def path_error(samples: Sequence[TruthSample], polyline: Sequence[Vector3], near_m: float = PASSED_M) -> PathResult:
    """Compares a flight with the requested path.

    Args:
        samples: the true positions, in time order (10 Hz is meant).
        polyline: where the vehicle was at the begin, then every waypoint.
        near_m: how near a waypoint is passed; what turns wide needs more, and then may be farther ahead.
    """
    ahead_m = max(LOOK_AHEAD_M, 4.0 * near_m)
    early_m = ROUNDING_M if near_m <= PASSED_M else near_m
    starts = [0.0]
    for a, b in itertools.pairwise(polyline):
        starts.append(starts[-1] + math.dist(a, b))
    errors: list[float] = []
    progress_m = 0.0
    passing: list[float | None] = [samples[0].t_s] + [None] * (len(polyline) - 1) if samples else []
    misses = [math.inf] * len(polyline)
    for sample in samples:
        error_m, reached_m = _nearest(sample.position_ned_m, polyline, starts, progress_m, ahead_m)
        errors.append(error_m)
        progress_m = max(progress_m, reached_m)
        for index in range(1, len(polyline)):
            if abs(starts[index] - progress_m) <= ahead_m:
                misses[index] = min(misses[index], math.dist(sample.position_ned_m, polyline[index]))
            is_reached = progress_m >= starts[index] - early_m
            if passing[index] is None and is_reached:
                passing[index] = sample.t_s
    legs = [_leg(starts, passing, misses, index) for index in range(1, len(polyline))]
    passed = 0
    for leg in legs:
        if leg.miss_m > near_m or leg.duration_s == math.inf:
            break
        passed += 1
    rms_m = math.sqrt(sum(error * error for error in errors) / len(errors)) if errors else math.inf
    return PathResult(rms_m, max(errors, default=math.inf), len(errors), legs, passed)


def _leg(starts: Sequence[float], passing: Sequence[float | None], misses: Sequence[float], index: int) -> LegResult:
    length_m = starts[index] - starts[index - 1]
    begin_s, end_s = (passing[index - 1], passing[index]) if passing else (None, None)
    duration_s = end_s - begin_s if begin_s is not None and end_s is not None else math.inf
    speed = length_m / duration_s if duration_s > 0.0 else 0.0
    return LegResult(length_m, duration_s, speed, misses[index])


def _nearest(
    position: Vector3, polyline: Sequence[Vector3], starts: Sequence[float], progress_m: float, ahead_m: float
) -> tuple[float, float]:
    """Distance to the polyline between `progress_m` and the look-ahead, and the path length to the nearest point."""
    best_m, best_at = math.inf, progress_m
    for index in range(len(polyline) - 1):
        if starts[index + 1] < progress_m or starts[index] > progress_m + ahead_m:
            continue
        a, b = polyline[index], polyline[index + 1]
        length_m = starts[index + 1] - starts[index]
        if length_m == 0.0:
            continue
        along = [(q - p) / length_m for p, q in zip(a, b, strict=True)]
        along_m = sum((x - p) * u for x, p, u in zip(position, a, along, strict=True))
        low = max(progress_m - starts[index], 0.0)
        high = min(progress_m + ahead_m - starts[index], length_m)
        along_m = min(max(along_m, low), high)
        point = [p + u * along_m for p, u in zip(a, along, strict=True)]
        distance_m = math.dist(position, point)
        if distance_m < best_m:
            best_m, best_at = distance_m, starts[index] + along_m
    return best_m, best_at
