"""Fault isolation by voting: finds the source whose motion disagrees with the others'.

Every source reports the motion since its last report. The differences from the fusion's estimate are summed up. Over a
window, the difference of two sources' sums is the disagreement between the *sources*: the estimate cancels, even where
a bad source has pulled it. Two sources agree where that difference is explained by their covariances and by an error of
scale that either may have. A source that disagrees with at least two others, and with more than each of these does, is
voted out. Where two disagree and no third can decide, neither is voted out: the conflict is reported, and the pose is
as uncertain as they differ. The inertial unit has a voice of its own: which of two sources has changed its motion without
an acceleration. Long before a vote is certain, the same sums show where the estimate would be without any one or two of
the sources: the pose is at least as uncertain as that.
"""

from bisect import bisect_left
from collections.abc import Iterator, Mapping
from itertools import combinations
from math import dist, inf
from typing import Final, NamedTuple

import numpy as np

from gloc3.messages.frames import Vector3
from gloc3_onboard.algorithms.fusion.error_state import Matrix
from gloc3_onboard.algorithms.fusion.inertial_motion import InertialMotion
from gloc3_onboard.algorithms.fusion.inertial_witness import InertialWitness
from gloc3_onboard.algorithms.fusion.measurements import CHI2_999
from gloc3_onboard.algorithms.fusion.source_record import BLIND_M2, MEAN_S, Record

_KEPT: Final = 1024
_WINDOWS: Final = (0.25, 0.5, 1.0)
"""Shorter windows see coarse errors sooner."""
_CHI2_AGAIN: Final = 7.81
"""One that was voted out agrees again below that, 95 %, three degrees of freedom: within what is usual."""
_SEPARATED: Final = (0.25, 1.0)
"""The windows in which one source is left out: errors that begin, and errors that stay."""
_COARSE_M2: Final = 0.1**2
"""A source that knows no direction better than that tells a doubt only where it contradicts another one; along a direction that
those that are left do not know better, they tell it only beyond two standard deviations."""
_FLOOR_M2: Final = 0.004**2
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


class FaultIsolation:
    """Compares the records of all sources a few times a second."""

    def __init__(self, window_s: float, scale_std: float, motion: InertialMotion) -> None:
        self.records: dict[str, Record] = {}
        self.witness: Final = InertialWitness(motion)
        self._motion = motion
        self._window_s, self._scale_std = window_s, scale_std
        self._latency_s: list[float] = []
        self._distance_m: list[float] = []
        """Distance flown up to each of these times."""
        self._at: Vector3 | None = None
        self._heading_std_rad = 0.0
        self._last: tuple[str, int] = ("", 0)
        self._inertial = (_NOTHING, np.zeros(3))
        """Inverse covariance (3, 3) of the inertial unit's motion over the shortest window, and that by the motion less the
        estimated one, with its corrections; zero where it is not believed."""
        self._apart_m: list[tuple[str, str, Vector3]] = []
        """Sources that contradict each other in the last vote, confirmed or not, and by how much."""

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
        able = [name for name, may in voters.items() if may]
        self.witness.expire(now_s)
        self._compare_inertial(now_s)
        found = self._verdict(able, now_s)
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
        pairs = [(other, since_s) for other in judges for since_s in begins]
        return bool(judges) and not any(self._difference(source, *pair, _CHI2_AGAIN) for pair in pairs)

    def contradiction(self, excluded: list[str], used: str, now_s: float) -> IsolationResult:
        """How a source that was voted out still contradicts the only one that is used, if any does."""
        for a, b, apart in self._differences([*excluded, used], now_s):
            if used in (a, b):
                return IsolationResult("", (a, b), apart)
        return IsolationResult()

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
        if len(group) < 2 or any(self._difference(a, b, begin_s) for a, b in combinations(group, 2)):
            return None
        # Weighted mean of the group: C = (sum C_i^-1)^-1, d = C sum C_i^-1 d_i.
        weights = {name: np.linalg.inv(reported[name][1]) for name in group}
        covariance = np.linalg.inv(sum(weights.values(), _NOTHING))
        by_m = covariance @ sum((weights[name] @ reported[name][0] for name in group), np.zeros(3))
        against = [
            name for name in able if name not in group and self._denies(reported[name], by_m, covariance, CHI2_999[3])
        ]
        if len(against) >= len(group):
            return None
        north, east, down = by_m.tolist()
        return OtherAgreement(tuple(group), (north, east, down), covariance)

    def separation(self, names: list[str], now_s: float, *, is_strict: bool = False) -> Vector3:
        """How far the position would be from its estimate if any one or two sources were left out, along each axis, m.

        This is solution separation, as satellite navigation monitors its integrity: whichever source is wrong, the others
        say how far it has moved the estimate. What their covariances explain is not counted. A single source says it alone:
        it may be right although it does not pass the gate.

        Args:
            names: the sources that are used, or may be right.
            now_s: the time.
            is_strict: the position is also as uncertain as without the best of them, as where a source has been wrong and
                nothing holds the position.
        """
        worst = np.zeros(3)
        for a, b, apart_m in self._apart_m:
            if a in names and b in names:
                worst = np.maximum(worst, np.square(apart_m))
        for share in _SEPARATED:
            begin_s = now_s - share * self._window_s
            able = [name for name in names if self._known(name, begin_s, now_s)]
            able = [name for name in able if np.linalg.eigvalsh(self.records[name].spread(begin_s))[0] < _COARSE_M2]
            if not able:
                continue
            turned_m2 = self._turned_m2(begin_s)
            records = [self.records[name] for name in able]
            floors = np.array([_FLOOR_M2 + (0.0 if record.is_of_places else turned_m2) for record in records])
            spreads = np.array([record.spread(begin_s) for record in records]) + floors[:, None, None] * np.eye(3)
            weights = np.asarray(np.linalg.inv(spreads), np.float64)
            moved_m = np.array([record.mean_over(begin_s) for record in records]) - self._motion.corrected(begin_s)[0]
            weighted = np.einsum("nij,nj->ni", weights, moved_m)
            one = 1.0 - np.eye(len(able)) if len(able) > 1 else np.ones((1, 1))
            weight, moved = self._inertial if share == _SEPARATED[0] else (_NOTHING, np.zeros(3))
            variances, squares = _without(one, weights, weighted, weight, moved)
            if is_strict:
                worst = np.maximum(worst, np.where(variances < BLIND_M2, squares + 0.25 * variances, 0.0).max(axis=0))
            counted = squares - np.where(variances > _COARSE_M2, 4.0, 1.0) * variances
            worst = np.maximum(worst, counted.max(axis=0))
            if len(able) > 2:
                two = np.array([one[a] * one[b] for a, b in combinations(range(len(able)), 2)])
                for weight_of, moved_by in ((_NOTHING, np.zeros(3)), (weight, moved)):
                    variances, squares = _without(two, weights, weighted, weight_of, moved_by)
                    worst = np.maximum(worst, (squares - 2.0 * variances).max(axis=0))
        north, east, down = np.sqrt(worst).tolist()
        return north, east, down

    def _compare_inertial(self, now_s: float) -> None:
        """Follows the motion by the inertial unit alone, and doubts the unit where sources that agree contradict it.

        One that contradicts it is denied by any other source, used or not, that has moved as the unit says and would have
        noticed the difference. Where nobody denies it, the unit is not used; where two such agree, it is wrong.
        """
        self._inertial = (_NOTHING, np.zeros(3))
        begin_s, end_s = now_s - _SEPARATED[0] * self._window_s, now_s - MEAN_S
        begin_s = next((t_s for t_s in self._motion.times if t_s > begin_s - 1e-6), now_s)
        inertial = self._motion.excess(begin_s, end_s) if begin_s < end_s else None
        if inertial is None:
            return
        for_it: list[tuple[Matrix, Matrix]] = []
        against: list[tuple[Matrix, Matrix]] = []
        for record in self.records.values():
            found = record.between(begin_s, end_s)
            if found is not None:
                turned_m2 = 0.0 if record.is_of_places else self._turned_m2(begin_s, end_s)
                moved = (found[0] - inertial[0], found[1] + (_FLOOR_M2 + turned_m2) * np.eye(3))
                (against if self._denies(moved, np.zeros(3), inertial[1], CHI2_999[3]) else for_it).append(moved)
        undenied = [one for one in against if not any(self._denies(other, *one, _CHI2_AGAIN) for other in for_it)]
        if any(not self._denies(one, *other, _CHI2_AGAIN) for one, other in combinations(undenied, 2)):
            self.witness.doubt(now_s)
        if not undenied and not self.witness.is_doubted(now_s):
            weight = np.asarray(np.linalg.inv(inertial[1]), np.float64)
            self._inertial = (weight, weight @ (inertial[0] - self._motion.corrected(begin_s)[0]))

    def dragged(self, names: list[str], now_s: float) -> Vector3 | None:
        """How far the position has been moved along each axis, m, away from where these sources would have it now.

        Args:
            names: the sources that are right.
            now_s: the time.

        Returns:
            None if none of them is known.
        """
        worst = np.zeros(3)
        able: list[Record] = []
        for share in _WINDOWS:
            begin_s = now_s - share * self._window_s
            able = [self.records[name] for name in names if self._known(name, begin_s, now_s)]
            if not able:
                break
            turned_m2 = self._turned_m2(begin_s)
            floors = np.array([0.0 if record.is_of_places else turned_m2 for record in able])
            weights = np.linalg.inv(
                np.array([record.spread(begin_s) for record in able]) + floors[:, None, None] * np.eye(3)
            )
            # Weighted mean: d = (sum C_i^-1)^-1 sum C_i^-1 d_i; the position itself was corrected, too.
            weighted = np.einsum("nij,nj->i", weights, np.array([record.mean_over(begin_s) for record in able]))
            by_m = np.linalg.solve(weights.sum(axis=0), weighted)
            worst = np.maximum(worst, np.abs(self._motion.corrected(begin_s)[0] - by_m))
        north, east, down = worst.tolist()
        return (north, east, down) if able or worst.any() else None

    def _turned_m2(self, begin_s: float, end_s: float = inf) -> float:
        """Variance of motions in body axes between two times, by the heading's."""
        return (self._heading_std_rad * (self._length(begin_s) - self._length(end_s))) ** 2

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
        known = directions[:, values < BLIND_M2].T @ by_m
        return float(known @ known) > CHI2_999[3] * self._tolerance(begin_s, is_turned=False)

    @staticmethod
    def _denies(reported: tuple[Matrix, Matrix], by_m: Matrix, covariance: Matrix, gate: float) -> bool:
        apart = reported[0] - by_m
        return float(apart @ np.linalg.solve(reported[1] + covariance, apart)) > gate

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

    def _difference(self, a: str, b: str, begin_s: float, gate: float = CHI2_999[3]) -> Vector3 | None:
        """Disagreement of two sources since a time; None where they agree, or one has no data."""
        one, two = self.records[a], self.records[b]
        ((ax, ay, az), spread_a), ((bx, by, bz), spread_b) = one.over(begin_s), two.over(begin_s)
        # Pairwise residual: the estimate cancels in a - b; its covariance is C_a + C_b + tolerance.
        apart = (ax - bx, ay - by, az - bz)
        tolerance = self._tolerance(begin_s, is_turned=one.is_of_places is not two.is_of_places)
        if sum(value * value for value in apart) <= gate * tolerance:
            return None  # whatever their covariances are
        spread = spread_a + spread_b + np.eye(3) * tolerance
        # Gate: squared Mahalanobis distance against chi-square, 3 degrees of freedom, 99.9 %.
        if apart @ np.linalg.solve(spread, apart) <= gate:
            return None
        values, directions = np.linalg.eigh(spread)
        known = directions[:, values < BLIND_M2]
        north, east, down = (known @ (known.T @ apart)).tolist()
        if north**2 + east**2 + down**2 <= gate * tolerance:
            return None  # nor is what they agree on
        return (north, east, down)

    def _differences(self, names: list[str], now_s: float) -> Iterator[tuple[str, str, Vector3]]:
        for share in _WINDOWS:
            begin_s = now_s - share * self._window_s
            able = [name for name in names if self._known(name, begin_s, now_s)]
            for a, b in combinations(able, 2):
                apart = self._difference(a, b, begin_s)
                if apart is not None:
                    yield a, b, apart

    def _verdict(self, names: list[str], now_s: float) -> IsolationResult:
        against: dict[str, dict[str, Vector3]] = {}
        self._apart_m.clear()
        for a, b, (x, y, z) in self._differences(names, now_s):
            self._apart_m.append((a, b, (x, y, z)))
            self.witness.judge((a, b), self.records, (x, y, z), self._turned_m2, now_s)
            against.setdefault(a, {})[b] = (x, y, z)
            against.setdefault(b, {})[a] = (-x, -y, -z)
        if not against:
            return IsolationResult()
        # Vote: culprit is who contradicts two others at least, and more than each of them does; else a tie. The inertial
        # unit is one of these others.
        count = {name: len(others) + (name in self.witness.against) for name, others in against.items()}
        worst = max(against, key=lambda name: count[name])
        others = against[worst]
        is_confirmed = len(others) >= 2 or worst in self.witness.clearly_against
        if is_confirmed and all(count[name] < count[worst] for name in others):
            return IsolationResult(worst, tuple(others), next(iter(others.values())))
        other = next(iter(others))
        return IsolationResult("", (worst, other), others[other])


def _without(kept: Matrix, weights: Matrix, weighted: Matrix, weight: Matrix, moved: Matrix) -> tuple[Matrix, Matrix]:
    """Variances and squared offsets, (m, 3), of the position by the sources that each row of (m, n) keeps.

    Args:
        kept: 1 for a source that is kept, 0 for one that is left out.
        weights: inverse covariances of the sources, (n, 3, 3).
        weighted: these by what the sources report, (n, 3).
        weight: inverse covariance of one that is always kept, (3, 3).
        moved: that by what it reports, (3,).
    """
    # Weighted mean: C = (sum C_i^-1)^-1, d = C sum C_i^-1 d_i.
    covariances = np.linalg.inv(np.einsum("mn,nij->mij", kept, weights) + weight)
    apart = np.einsum("mij,mj->mi", covariances, kept @ weighted + moved)
    return covariances.diagonal(axis1=1, axis2=2), apart**2
