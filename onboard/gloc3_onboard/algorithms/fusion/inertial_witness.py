"""The inertial unit as a witness where two sources contradict each other: which of them began to move unfelt?

Two sources part because one of them reports a velocity that has changed without any acceleration. Over one or two seconds
the inertial unit knows the motion to some millimetres, and it shares no cause with any other source. So it often knows
which of the two it is, and whether most of the sources are wrong together. Only the begin of an error can be seen: later
the estimated velocity has followed it, and then the other one seems to have moved unfelt. So the begin is sought in the
difference of the two, whatever the estimate has done since, and what was found stays for as long as they contradict each
other.

The unit may be wrong itself: scaled, biased by a blow, shaken, late. It has an alibi only while one of the two has moved as
it says. Where all sources contradict it at once, it is the one that is wrong, and is not asked for some time.
"""

from collections.abc import Callable, Mapping
from math import inf
from typing import Final, NamedTuple

import numpy as np

from gloc3.messages.frames import Vector3
from gloc3_onboard.algorithms.fusion.error_state import Matrix
from gloc3_onboard.algorithms.fusion.inertial_motion import InertialMotion
from gloc3_onboard.algorithms.fusion.source_record import Record

_LENGTHS_S: Final = (0.7, 2.1)
"""Shortest and longest window."""
_LEAST: Final = 3.0
"""Standard deviations of the inertial unit and the sources by which the two must be apart, to be told by it."""
_SHARES: Final = (1.5, 4.0)
"""So many times must the one's squared differences from it be the other one's, to be held against it, and to decide."""
_UNDECIDED_S: Final = 3.0
"""So long a contradiction is looked at; later its begin is past."""
_ANEW_S: Final = 0.8
"""After so long without it, it is another one."""
_KEPT_S: Final = 3.0
"""So long after the last contradiction it counts."""
_ALIBI: Final = 3.0
"""Standard deviations from the inertial unit up to which one of the two speaks for it."""
_DOUBTED_S: Final = 12.0
"""So long the inertial unit is no witness after all sources have contradicted it."""


class _Finding(NamedTuple):
    """Of two sources that contradict each other."""

    name: str
    """Who it is; empty while that is not known."""
    is_clear: bool
    first_s: float
    last_s: float
    """When they have contradicted each other."""


class InertialWitness:
    """Says of two sources which one has changed its motion without an acceleration.

    Args:
        motion: of the inertial unit alone.
    """

    def __init__(self, motion: InertialMotion) -> None:
        self._motion = motion
        self._pairs: dict[tuple[str, str], _Finding] = {}
        self._doubted_s = -inf

    def doubt(self, now_s: float) -> None:
        """Drops all that the inertial unit has said, and does not ask it for some time: it is alone against all."""
        self._doubted_s = now_s
        self._pairs.clear()

    def is_doubted(self, now_s: float) -> bool:
        """Whether the inertial unit is no witness now."""
        return now_s - self._doubted_s < _DOUBTED_S

    @property
    def against(self) -> frozenset[str]:
        """The sources that the inertial unit contradicts."""
        return frozenset(found.name for found in self._pairs.values() if found.name)

    @property
    def clearly_against(self) -> frozenset[str]:
        """Those of them of which that is as certain as if another source said it."""
        return frozenset(found.name for found in self._pairs.values() if found.is_clear)

    def expire(self, now_s: float) -> None:
        """Drops what was found of sources that do not contradict each other any more."""
        self._pairs = {pair: found for pair, found in self._pairs.items() if now_s - found.last_s < _KEPT_S}

    def judge(
        self,
        pair: tuple[str, str],
        records: Mapping[str, Record],
        apart_m: Vector3,
        turned: Callable[[float, float], float],
        now_s: float,
    ) -> None:
        """Looks at two sources that contradict each other.

        Args:
            pair: their names.
            records: of all sources.
            apart_m: by how much the first moves away from the second, in NED.
            turned: variance (m2) of motions in body axes between two times, by the heading's.
            now_s: the time.
        """
        if self.is_doubted(now_s):
            return
        found = self._pairs.get(pair, _Finding("", False, now_s, now_s))
        if not found.name and now_s - found.last_s > _ANEW_S:
            found = found._replace(first_s=now_s)
        if not found.is_clear and now_s - found.first_s < _UNDECIDED_S:
            name, is_clear = self._unfelt(pair, records, np.array(apart_m), turned)
            found = found._replace(name=name or found.name, is_clear=is_clear)
        self._pairs[pair] = found._replace(last_s=now_s)

    def _unfelt(
        self,
        pair: tuple[str, str],
        records: Mapping[str, Record],
        apart_m: Matrix,
        turned: Callable[[float, float], float],
    ) -> tuple[str, bool]:
        """Whose motion differs from the inertial unit's since they part, and whether that is clear; empty if neither's."""
        away = apart_m / float(np.linalg.norm(apart_m))
        one, two = (records[name] for name in pair)
        begin_s = self._begin(one, two, away)
        squares, sizes, nearest = np.zeros(2), [0.0], [0.0]
        for end_s in self._motion.times:
            inertial = self._motion.excess(begin_s, end_s)
            first, second = one.between(begin_s, end_s), two.between(begin_s, end_s)
            if not _LENGTHS_S[0] <= end_s - begin_s <= _LENGTHS_S[1] or not first or not second or not inertial:
                continue
            moved = np.array([away @ (by_m - inertial[0]) for by_m, _ in (first, second)])
            spread = inertial[1] + turned(begin_s, end_s) * np.eye(3) + 0.5 * (first[1] + second[1])
            std_m = float(np.sqrt(away @ spread @ away))
            sizes.append(float(moved[0] - moved[1]) / std_m)
            nearest.append(float(np.abs(moved).min()) / std_m)
            squares += ((end_s - begin_s) * moved) ** 2
        if max(sizes[-2:]) < _LEAST or max(nearest[-2:]) > _ALIBI:
            return "", False
        # Which one has stayed with the inertial unit? Its differences are noise, the other one's grow with the time.
        name = pair[0] if squares[0] > squares[1] else pair[1]
        share = float(squares.max() / max(squares.min(), 1e-12))
        return name if share > _SHARES[0] else "", share > _SHARES[1]

    def _begin(self, one: Record, two: Record, away: Matrix) -> float:
        """When two sources have begun to part: the bend of the line that fits their difference best."""
        rows = []
        for t_s in self._motion.times:
            first, second = one.between(self._motion.times[0], t_s), two.between(self._motion.times[0], t_s)
            if first and second:
                rows.append((t_s, float(away @ (first[0] - second[0]))))
        if len(rows) < 4:
            return inf
        times, differences = np.array(rows).T
        best = (inf, inf)
        for index in range(1, len(times) - 2):
            design = np.stack((np.ones_like(times), np.maximum(times - times[index], 0.0)), axis=1)
            fitted, *_ = np.linalg.lstsq(design, differences, rcond=None)
            best = min(best, (float(np.sum((differences - design @ fitted) ** 2)), float(times[index - 1])))
        return best[1]
