"""The motion that one source has reported, less the estimated one: what the vote compares."""

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterator
from itertools import islice
from typing import Final

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


class Record:
    """The motion that one source has reported."""

    def __init__(self) -> None:
        self.is_of_places = False
        """Whether it is reported in NED, not in body axes, which depend on the estimated attitude."""
        self._times: deque[float] = deque(maxlen=_KEPT)
        self._sums: deque[tuple[float, float, float, Matrix]] = deque(maxlen=_KEPT)
        """Of the excess; and of the covariances, each that of the last report from a reference."""
        self._covariance: Matrix = np.eye(3)
        self._axes: Quaternion = IDENTITY
        self._spread: Matrix | None = None
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
        x, y, z, spread = self._sums[-1] if self._sums else (0.0, 0.0, 0.0, _NOTHING)
        if is_new_reference and self._sums:
            spread = spread + self.covariance
        self._times.append(t_s)
        ex, ey, ez = excess_ned_m
        self._sums.append((x + ex, y + ey, z + ez, spread))
        self._covariance, self._axes, self._spread = covariance, ned_from_axes, None

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
        bx, by, bz, _ = self._sums[self._first(begin_s)]
        x, y, z, _ = self._sums[-1]
        return (x - bx, y - by, z - bz), self.spread(begin_s)

    def spread(self, begin_s: float) -> Matrix:
        """Covariance (3, 3) of the motion since a time, in NED."""
        return 2.0 * self.covariance + (self._sums[-1][3] - self._sums[self._first(begin_s)][3])

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
        sums, counts = [], []
        for t_s in (begin_s, end_s):
            first, last = (bisect_left(self._times, t_s + by_s) for by_s in (-_ABOUT_S, _ABOUT_S))
            if first == last or self._times[-1] < t_s:
                return None
            sums.append(_mean(islice(self._sums, first, last)))
            counts.append(last - first)
        references = self._sums[self._first(end_s)][3] - self._sums[self._first(begin_s)][3]
        # Errors of positions are independent; those of one reference's reports are not.
        share = 1.0 / counts[0] + 1.0 / counts[1] if self.is_of_places else 2.0
        return sums[1] - sums[0], share * self.covariance + references

    @property
    def sees_vertical(self) -> bool:
        """Whether it measures vertical motion, as its last report says."""
        return float(self.covariance[2, 2]) < BLIND_M2

    @property
    def covariance(self) -> Matrix:
        """Covariance of the last report's end, (3, 3), in NED."""
        if self._spread is None:
            axes = matrix_of(self._axes)
            self._spread = axes @ self._covariance @ axes.T
        return self._spread


def _mean(sums: Iterator[tuple[float, float, float, Matrix]]) -> Matrix:
    rows = [(x, y, z) for x, y, z, _ in sums]
    return np.array([sum(column) / len(rows) for column in zip(*rows, strict=True)])
