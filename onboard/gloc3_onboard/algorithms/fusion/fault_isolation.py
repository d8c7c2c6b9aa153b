"""Fault isolation by voting: finds the source whose motion disagrees with the others'.

Every source reports the motion since its last report. The differences from the fusion's estimate are summed up. Over a
window, the difference of two sources' sums is the disagreement between the *sources*: the estimate cancels, even where
a bad source has pulled it. Two sources agree where that difference is explained by their covariances and by an error of
scale that either may have. A source that disagrees with at least two others, and with more than each of these does, is
voted out. Where two disagree and no third can decide, neither is voted out: the conflict is reported, and the pose is
as uncertain as they differ. Long before a vote is certain, the same sums show where the estimate would be without any one
source: the pose is at least as uncertain as that.
"""

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterator, Mapping
from itertools import combinations, islice
from math import dist
from typing import Final, NamedTuple

import numpy as np

from gloc3.messages.frames import IDENTITY, Quaternion, Vector3
from gloc3_onboard.algorithms.fusion.error_state import Matrix
from gloc3_onboard.algorithms.fusion.measurements import CHI2_999, matrix_of

_KEPT: Final = 1024
_PULLS_S: Final = 6.0
_WINDOWS: Final = (0.25, 0.5, 1.0)
"""Shorter windows see coarse errors sooner."""
_MEAN_S: Final = 0.5
"""Time over which reports are averaged at both ends of a window."""
_SEPARATED: Final = (0.25, 1.0)
"""The windows in which one source is left out: errors that begin, and errors that stay."""
_COARSE_M2: Final = 0.1**2
"""Sources that are left and do not know better than that tell a doubt only beyond two standard deviations."""
_FLOOR_M2: Final = 0.004**2
_BLIND_M2: Final = 0.5**2
"""Variance beyond which a direction is ignored in a disagreement."""
_NOTHING: Final = np.zeros((3, 3))
_CONFIRM: Final = 2
"""Votes in a row with the same outcome, before it counts."""


class IsolationResult(NamedTuple):
    """The outcome of a vote."""

    voted_out: str = ""
    against: tuple[str, ...] = ()
    """Whom the one that was voted out contradicts, or the two that contradict each other."""
    apart_m: Vector3 = (0.0, 0.0, 0.0)
    """By how much, in NED."""

    @property
    def is_unanimous(self) -> bool:
        """Whether no source contradicts another."""
        return not self.against


class OtherAgreement(NamedTuple):
    """Sources that agree with each other but not with the estimate."""

    names: tuple[str, ...]
    by_m: Vector3
    """Offset of the body from its estimated position, according to them, in NED."""
    covariance: Matrix
    """Of that, (3, 3)."""


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
        early = bisect_right(self._times, self._times[first] + _MEAN_S)
        late = bisect_left(self._times, self._times[-1] - _MEAN_S)
        begin, end = _mean(islice(self._sums, first, early)), _mean(islice(self._sums, late, None))
        return end - begin

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


class FaultIsolation:
    """Compares the records of all sources a few times a second."""

    def __init__(self, window_s: float, scale_std: float) -> None:
        self.records: dict[str, Record] = {}
        self._window_s, self._scale_std = window_s, scale_std
        self._latency_s: list[float] = []
        self._distance_m: list[float] = []
        """Distance flown up to each of these times."""
        self._at: Vector3 | None = None
        self._heading_std_rad = 0.0
        self._last: tuple[str, int] = ("", 0)

    def record(self, source: str) -> Record:
        """The record of a source."""
        record = self.records.get(source)
        if record is None:
            record = self.records[source] = Record()
        return record

    def update(
        self, voters: Mapping[str, bool], position: Vector3, heading_std_rad: float, now_s: float
    ) -> IsolationResult:
        """Runs one vote.

        Args:
            voters: the sources that may vote.
            position: estimated position, for the distance flown.
            heading_std_rad: of the estimated heading, with which the odometers' motion is rotated.
            now_s: the time.
        """
        self._heading_std_rad = heading_std_rad
        self._travel(position, now_s)
        found = self._verdict([name for name, may in voters.items() if may], now_s)
        key = found.voted_out or "/".join(found.against)
        self._last = (key, self._last[1] + 1 if key == self._last[0] else 1)
        return found if self._last[1] >= _CONFIRM else IsolationResult()

    def agrees(self, source: str, others: list[str], now_s: float, distance_m: float = 1.0) -> bool:
        """Whether a source that was voted out has agreed with the others over a full window and a distance."""
        begin_s = now_s - self._window_s
        if self._length(begin_s) < distance_m or not self._known(source, begin_s, now_s):
            return False
        judges = [other for other in others if self._known(other, begin_s, now_s)]
        begins = [now_s - share * self._window_s for share in _WINDOWS]
        return bool(judges) and not any(self._apart(source, other, since_s) for other in judges for since_s in begins)

    def elsewhere(self, names: list[str], begin_s: float, now_s: float) -> OtherAgreement | None:
        """The offset from the estimate that two or more sources agree on, unless as many contradict it.

        Args:
            names: the sources considered.
            begin_s: start of the reports considered.
            now_s: the time.
        """
        able = [name for name in names if self._known(name, begin_s, now_s)]
        reported = {name: self._excess(name, begin_s) for name in able}
        group = [name for name, (by_m, spread) in reported.items() if self._is_reported(by_m, spread, begin_s)]
        if len(group) < 2 or any(self._apart(a, b, begin_s) for a, b in combinations(group, 2)):
            return None
        # Weighted mean of the group: C = (sum C_i^-1)^-1, d = C sum C_i^-1 d_i.
        weights = {name: np.linalg.inv(reported[name][1]) for name in group}
        covariance = np.linalg.inv(sum(weights.values(), _NOTHING))
        by_m = covariance @ sum((weights[name] @ reported[name][0] for name in group), np.zeros(3))
        against = [name for name in able if name not in group and self._denies(reported[name], by_m, covariance)]
        if len(against) >= len(group):
            return None
        north, east, down = by_m.tolist()
        return OtherAgreement(tuple(group), (north, east, down), covariance)

    def separation(self, names: list[str], now_s: float) -> Vector3:
        """How far the position would be from its estimate if any one source were left out, along each axis, m.

        This is solution separation, as satellite navigation monitors its integrity: whichever source is wrong, the others
        say how far it has moved the estimate. What their covariances explain is not counted.

        Args:
            names: the sources that are used.
            now_s: the time.
        """
        worst = np.zeros(3)
        for share in _SEPARATED:
            begin_s = now_s - share * self._window_s
            able = [name for name in names if self._known(name, begin_s, now_s)]
            if len(able) < 2:
                continue
            turned_m2 = (self._heading_std_rad * self._length(begin_s)) ** 2
            records = [self.records[name] for name in able]
            floors = np.array([_FLOOR_M2 + (0.0 if record.is_of_places else turned_m2) for record in records])
            spreads = np.array([record.spread(begin_s) for record in records]) + floors[:, None, None] * np.eye(3)
            weights = np.linalg.inv(spreads)
            weighted = np.einsum("nij,nj->ni", weights, np.array([record.mean_over(begin_s) for record in records]))
            # Weighted mean of the others: C = (sum C_i^-1)^-1, d = C sum C_i^-1 d_i; counted is d^2 - C, or d^2 - 4 C.
            covariances = np.linalg.inv(weights.sum(axis=0) - weights)
            apart = np.einsum("nij,nj->ni", covariances, weighted.sum(axis=0) - weighted)
            variances = covariances.diagonal(axis1=1, axis2=2)
            counted = apart**2 - np.where(variances > _COARSE_M2, 4.0, 1.0) * variances
            worst = np.maximum(worst, counted.max(axis=0))
        north, east, down = np.sqrt(worst).tolist()
        return north, east, down

    def _excess(self, name: str, begin_s: float) -> tuple[Matrix, Matrix]:
        """Excess of a source's motion since a time over the estimate, and its covariance."""
        record = self.records[name]
        by_m, spread = record.over(begin_s)
        return np.array(by_m), spread + np.eye(3) * self._tolerance(begin_s, is_turned=not record.is_of_places)

    def _is_reported(self, by_m: Matrix, spread: Matrix, begin_s: float) -> bool:
        """Whether a difference is more than its covariance explains, also along the directions that are known."""
        # Gate: d^T C^-1 d against chi-square, 3 degrees of freedom; then d along the well-known eigenvectors.
        if by_m @ np.linalg.solve(spread, by_m) <= CHI2_999[3]:
            return False
        values, directions = np.linalg.eigh(spread)
        known = directions[:, values < _BLIND_M2].T @ by_m
        return float(known @ known) > CHI2_999[3] * self._tolerance(begin_s, is_turned=False)

    @staticmethod
    def _denies(reported: tuple[Matrix, Matrix], by_m: Matrix, covariance: Matrix) -> bool:
        apart = reported[0] - by_m
        return float(apart @ np.linalg.solve(reported[1] + covariance, apart)) > CHI2_999[3]

    def _tolerance(self, begin_s: float, *, is_turned: bool) -> float:
        """Variance by which motions since a time may differ, m2: scale error, and heading error if one is rotated."""
        share = self._scale_std**2 + (self._heading_std_rad**2 if is_turned else 0.0)
        return share * self._length(begin_s) ** 2 + _FLOOR_M2

    def _travel(self, position: Vector3, now_s: float) -> None:
        step = 0.0 if self._at is None else dist(position, self._at)
        self._at = position
        self._latency_s.append(now_s)
        self._distance_m.append((self._distance_m[-1] if self._distance_m else 0.0) + step)
        if len(self._latency_s) > _KEPT:
            del self._latency_s[: _KEPT // 2], self._distance_m[: _KEPT // 2]

    def _length(self, begin_s: float) -> float:
        """Distance flown since a time."""
        first = min(bisect_left(self._latency_s, begin_s), len(self._distance_m) - 1)
        return self._distance_m[-1] - self._distance_m[first]

    def _known(self, source: str, begin_s: float, now_s: float) -> bool:
        record = self.records.get(source)
        return record is not None and record.is_about(begin_s, now_s)

    def _apart(self, a: str, b: str, begin_s: float) -> Vector3 | None:
        """Disagreement of two sources since a time; None where they agree, or one has no data."""
        one, two = self.records[a], self.records[b]
        ((ax, ay, az), spread_a), ((bx, by, bz), spread_b) = one.over(begin_s), two.over(begin_s)
        # Pairwise residual: the estimate cancels in a - b; its covariance is C_a + C_b + tolerance.
        apart = (ax - bx, ay - by, az - bz)
        tolerance = self._tolerance(begin_s, is_turned=one.is_of_places is not two.is_of_places)
        if sum(value * value for value in apart) <= CHI2_999[3] * tolerance:
            return None  # whatever their covariances are
        spread = spread_a + spread_b + np.eye(3) * tolerance
        # Gate: squared Mahalanobis distance against chi-square, 3 degrees of freedom, 99.9 %.
        if apart @ np.linalg.solve(spread, apart) <= CHI2_999[3]:
            return None
        values, directions = np.linalg.eigh(spread)
        known = directions[:, values < _BLIND_M2]
        north, east, down = (known @ (known.T @ apart)).tolist()
        if north**2 + east**2 + down**2 <= CHI2_999[3] * tolerance:
            return None  # nor is what they agree on
        return (north, east, down)

    def _differences(self, names: list[str], now_s: float) -> Iterator[tuple[str, str, Vector3]]:
        for share in _WINDOWS:
            begin_s = now_s - share * self._window_s
            able = [name for name in names if self._known(name, begin_s, now_s)]
            for a, b in combinations(able, 2):
                apart = self._apart(a, b, begin_s)
                if apart is not None:
                    yield a, b, apart

    def _verdict(self, names: list[str], now_s: float) -> IsolationResult:
        against: dict[str, dict[str, Vector3]] = {}
        for a, b, (x, y, z) in self._differences(names, now_s):
            against.setdefault(a, {})[b] = (x, y, z)
            against.setdefault(b, {})[a] = (-x, -y, -z)
        if not against:
            return IsolationResult()
        # Vote: culprit is who contradicts two others at least, and more than each of them does; else a tie.
        worst = max(against, key=lambda name: len(against[name]))
        others = against[worst]
        if len(others) >= 2 and all(len(against[name]) < len(others) for name in others):
            return IsolationResult(worst, tuple(others), next(iter(others.values())))
        other = next(iter(others))
        return IsolationResult("", (worst, other), others[other])
