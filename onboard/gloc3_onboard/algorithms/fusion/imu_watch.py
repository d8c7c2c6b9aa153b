"""Plausibility checks of IMU samples."""

from math import hypot, isfinite
from typing import Final, NamedTuple

from gloc3.messages.frames import Vector3
from gloc3_onboard.algorithms.fusion.estimate import LONGEST_S
from gloc3_onboard.algorithms.fusion.trust import Trust

_FASTEST: Final = (35.0, 160.0)
"""Limits of rate and specific force, rad/s and m/s², beyond which a sample is invalid."""
_ABRUPT: Final = (10.0, 80.0)
"""And no vehicle's motion changes by more from one sample to the next."""
_JOLT_M_S2: Final = 6.0
"""Change of the specific force between samples beyond which the values in between are unknown."""
_JOLT_S: Final = 0.02
_RUN: Final = 20
"""Equal samples that count as frozen; also the good samples after which the unit is used again."""
_SETTLED: Final = 4
"""Good samples required after a bad one, because garbage may follow garbage undetected."""
_BLIND_S: Final = (3.0, 60.0)
"""So long it is not believed after a doubt; each time twice as long as before, and at most the second."""
_AHEAD_S: Final = 0.5


class Mean(NamedTuple):
    """Mean rate and specific force since the sample before."""

    rate_frd_rad_s: Vector3
    force_frd_m_s2: Vector3
    is_believed: bool
    jolt_m_s: float = 0.0
    """How wrong the velocity may be that follows from it, beside all noise: at a touch-down."""


class ImuWatch:
    """Checks every sample before it moves the estimate."""

    def __init__(self) -> None:
        self._last: tuple[Vector3, Vector3] | None = None
        self._last_s = float("-inf")
        self._same = 0
        self._jolt_m_s = 0.0
        self._good = _RUN
        self._blind_until_s = float("-inf")
        self._blind_s = _BLIND_S[0]

    def add_sample(
        self, rate: Vector3, force: Vector3, t_s: float, now_s: float, estimated_s: float, trust: Trust
    ) -> Mean | None:
        """Mean values since the last sample; None for an unusable sample.

        Args:
            rate: angular rate, rad/s.
            force: specific force, m/s².
            t_s: time of the sample.
            now_s: the time by other sources; a sample must not be far ahead of it.
            estimated_s: the time to which the estimate has gone on, perhaps without the unit; a sample must be newer.
            trust: the record of the inertial unit.
        """
        is_ahead = self._last is not None and t_s > max(now_s, self._last_s) + _AHEAD_S
        if not isfinite(t_s) or is_ahead:
            trust.refuse("its time is none")
            return None
        if self._last is not None and self._same < _RUN:
            self._measure_forces(force, min(max(t_s - self._last_s, 0.0), _JOLT_S))
        if self._is_beyond_measure(rate, force):
            trust.refuse("its numbers are beyond all measure")
            self._good = 0
            return None
        self._good += 1
        before, gap_s = self._last, t_s - self._last_s
        self._same = self._same + 1 if (rate, force) == before else 0
        self._last = (rate, force)
        if self._same >= _RUN:
            trust.turn_down("frozen")
            self._good = 0
        if gap_s > 0.0 and t_s <= estimated_s:
            self._last_s = t_s
            trust.refuse(f"late by {now_s - t_s:.2f} s")
            self._good = 0
            return None
        if gap_s <= 0.0 or self._good < (_SETTLED if trust.is_used else _RUN):
            return None
        self._last_s = t_s
        is_believed = t_s >= self._blind_until_s
        if is_believed and not trust.is_used:
            trust.let_in()
        trust.accepted += 1
        jolt_m_s, self._jolt_m_s = self._jolt_m_s, 0.0
        if before is None or gap_s > LONGEST_S:
            return Mean(rate, force, is_believed, jolt_m_s)
        return Mean(_middle(before[0], rate), _middle(before[1], force), is_believed, jolt_m_s)

    def distrust(self, now_s: float, reason: str, trust: Trust) -> None:
        """Distrusts the IMU for some seconds."""
        self._blind_until_s = now_s + self._blind_s
        self._blind_s = min(2.0 * self._blind_s, _BLIND_S[1])
        trust.turn_down(reason)

    def is_distrusted(self, now_s: float) -> bool:
        """Whether the IMU is distrusted now."""
        return now_s < self._blind_until_s

    def _measure_forces(self, force: Vector3, gap_s: float) -> None:
        """Notes a change that a sample now and then does not follow."""
        assert self._last is not None
        (x, y, z), (u, v, w) = force, self._last[1]
        change = min(hypot(x - u, y - v, z - w), _FASTEST[1])
        if change > _JOLT_M_S2:
            # The trapezoid may be wrong by dv = |f - f_before| dt / 2.
            self._jolt_m_s += 0.5 * change * gap_s

    def _is_beyond_measure(self, rate: Vector3, force: Vector3) -> bool:
        """Whether no vehicle moves like that; between two samples at that."""
        if not all(map(isfinite, (*rate, *force))) or hypot(*rate) > _FASTEST[0] or hypot(*force) > _FASTEST[1]:
            return True
        if self._last is None or self._good == 0:
            return False
        (p, q, r), (x, y, z) = self._last
        turned = hypot(rate[0] - p, rate[1] - q, rate[2] - r)
        return turned > _ABRUPT[0] or hypot(force[0] - x, force[1] - y, force[2] - z) > _ABRUPT[1]


def _middle(a: Vector3, b: Vector3) -> Vector3:
    return (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2]))
