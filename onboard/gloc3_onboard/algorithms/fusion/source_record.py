"""The motion that one source has reported, less the estimated one: what the vote compares."""

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterator
from itertools import islice
from typing import Final, NamedTuple

import numpy as np

from gloc3.messages.frames import IDENTITY, Quaternion, Vector3
from gloc3_onboard.algorithms.fusion.error_state import Matrix
from gloc3_onboard.algorithms.fusion.measurements import matrix_of

_KEPT: Final = 1024
_PULLS_S: Final = 6.0
MEAN_S: Final = 0.3
"""Time over which reports are averaged at both ends of a window."""
_ABOUT_S: Final = 0.13
"""Reports so far from a time are about it."""
BLIND_M2: Final = 0.5**2
"""Variance beyond which a direction is not measured."""
_NOTHING: Final = np.zeros((3, 3))


class _Sum(NamedTuple):
    """What has been reported up to a report."""

    x: float
    y: float
    z: float
    """Of the excess, in NED."""
    references: Matrix
    """Sum of the covariances of the last report from each reference before."""
    covariance: Matrix
    """Of the report itself, in its axes."""
    ned_from_axes: Quaternion

    def in_ned(self) -> Matrix:
        """Covariance of the report itself, (3, 3)."""
        axes = matrix_of(self.ned_from_axes)
        return np.asarray(axes @ self.covariance @ axes.T, np.float64)


class Record:
    """The motion that one source has reported."""

    def __init__(self) -> None:
        self.is_of_places = False
        """Whether it is reported in NED, not in body axes, which depend on the estimated attitude."""
        self._times: deque[float] = deque(maxlen=_KEPT)
        self._sums: deque[_Sum] = deque(maxlen=_KEPT)
        self._spread: Matrix | None = None
        """Covariance of the last report, in NED, once it is asked for."""
        self._pulls: deque[tuple[float, Vector3]] = deque(maxlen=_KEPT)

    def add(
        self,
        t_s: float,
        excess_ned_m: Vector3,
        covariance: Matrix,
        ned_from_axes: Quaternion = IDENTITY,
        *,
        is_new_reference: bool = False,
    ) -> None:
        """Adds a report: its motion less the estimated one, and the covariance (3, 3) of its end, in some axes."""
        x, y, z, spread = self._sums[-1][:4] if self._sums else (0.0, 0.0, 0.0, _NOTHING)
        if is_new_reference and self._sums:
            spread = spread + self.covariance
        self._times.append(t_s)
        ex, ey, ez = excess_ned_m
        self._sums.append(_Sum(x + ex, y + ey, z + ez, spread, covariance, ned_from_axes))
        self._spread = None

    def pull(self, moved_m: Vector3, t_s: float) -> None:
        """Records how far an absolute position has moved the estimate."""
        self._pulls.append((t_s, moved_m))

    @property
    def pulled_m(self) -> Vector3 | None:
        """How far it has moved the estimate lately; None for a source of motions, not positions."""
        if not self._pulls:
            return None
        since_s = self._pulls[-1][0] - _PULLS_S
        north, east, down = zip(*(moved for t_s, moved in self._pulls if t_s >= since_s), strict=True)
        return (sum(north), sum(east), sum(down))

    def reset(self) -> None:
        """Clears the record."""
        self._times.clear()
        self._sums.clear()

    def is_about(self, begin_s: float, now_s: float) -> bool:
        """Whether the record covers a time from `begin_s` to almost now."""
        return bool(self._times) and self._times[0] <= begin_s + 0.3 and now_s - self._times[-1] < 0.8

    def over(self, begin_s: float) -> tuple[Vector3, Matrix]:
        """Sum of the excess since a time, and its covariance (3, 3) in NED, with a part for each reference."""
        begin, end = self._sums[self._first(begin_s)], self._sums[-1]
        return (end.x - begin.x, end.y - begin.y, end.z - begin.z), self.spread(begin_s)

    def spread(self, begin_s: float) -> Matrix:
        """Covariance (3, 3) of the motion since a time, in NED: of the reports at both ends, and of the references between."""
        begin = self._sums[self._first(begin_s)]
        return begin.in_ned() + self.covariance + (self._sums[-1].references - begin.references)

    def _first(self, begin_s: float) -> int:
        """The last report at a time."""
        return min(max(bisect_right(self._times, begin_s) - 1, 0), len(self._times) - 1)

    def mean_over(self, begin_s: float) -> Matrix:
        """The excess since a time, (3,), as a mean of some reports at both ends: their noise averages out."""
        first = self._first(begin_s)
        early = bisect_right(self._times, self._times[first] + MEAN_S)
        late = bisect_left(self._times, self._times[-1] - MEAN_S)
        begin, end = _mean(islice(self._sums, first, early)), _mean(islice(self._sums, late, None))
        return end - begin

    def between(self, begin_s: float, end_s: float) -> tuple[Matrix, Matrix] | None:
        """The excess between two times, (3,), as a mean of some reports about each, and its covariance (3, 3).

        Returns:
            None where there is no report about one of them.
        """
        sums, counts, ends = [], [], []
        for t_s in (begin_s, end_s):
            first, last = (bisect_left(self._times, t_s + by_s) for by_s in (-_ABOUT_S, _ABOUT_S))
            if first == last or self._times[-1] < t_s:
                return None
            sums.append(_mean(islice(self._sums, first, last)))
            counts.append(last - first)
            ends.append(self._sums[self._first(t_s)])
        references = ends[1].references - ends[0].references
        # Errors of positions are independent; those of one reference's reports are not.
        shares = [1.0 / count if self.is_of_places else 1.0 for count in counts]
        own = shares[0] * ends[0].in_ned() + shares[1] * ends[1].in_ned()
        return sums[1] - sums[0], own + references

    @property
    def sees_vertical(self) -> bool:
        """Whether it measures vertical motion, as its last report says."""
        return float(self.covariance[2, 2]) < BLIND_M2

    @property
    def covariance(self) -> Matrix:
        """Covariance of the last report's end, (3, 3), in NED."""
        if self._spread is None:
            self._spread = self._sums[-1].in_ned() if self._sums else np.eye(3)
        return self._spread


def _mean(sums: Iterator[_Sum]) -> Matrix:
    rows = [one[:3] for one in sums]
    return np.array([sum(column) / len(rows) for column in zip(*rows, strict=True)])
