"""The autopilot's turn rates as a witness of the inertial unit: both feel the same turns at the same time.

An inertial unit whose samples are old is not noticed as long as the vehicle flies straight. When it manoeuvres, the pose
follows each turn late, the vehicle is steered by that, and within a second the flight swings. The autopilot stabilises the
vehicle by its own gyroscopes, so as long as it flies they are right. A rate of theirs counts as felt where the inertial unit
has felt about as much a moment before or after: neither the autopilot's filters nor the vibrations that these take away, nor
an exposure or a link of some milliseconds, make the two differ.
"""

from collections import deque
from typing import Final

from gloc3.messages.frames import Vector3

_KEPT_S: Final = 1.0
"""A report of the autopilot is no later than that."""
_MOMENT_S: Final = (0.1, 0.05)
"""So long before and after a reported rate the unit may have felt it."""
_TOLERANCE: Final = (0.02, 0.15)
"""Difference that is still the same turn, rad/s, and as a share of the rate."""
_TURNING_RAD_S: Final = 0.1
"""Slower turns show no agreement in time."""
_AGREED: Final = 10
"""So many turns in a row must the two have felt alike, before one is a witness of the other: their clocks agree."""
_REPORTS, _MISSES = 12, 5
"""Of so many reports as many that the unit has not felt contradict it."""


class TurnWitness:
    """Compares what the inertial unit and the autopilot have felt."""

    def __init__(self) -> None:
        self._felt: deque[tuple[float, Vector3]] = deque()
        self._agreed = 0
        self._missed: deque[bool] = deque(maxlen=_REPORTS)
        self._last: Vector3 | None = None

    def feel(self, rate_frd_rad_s: Vector3, t_s: float) -> None:
        """Notes a rate of the inertial unit, less its bias."""
        self._felt.append((t_s, rate_frd_rad_s))
        while self._felt[0][0] < t_s - _KEPT_S:
            self._felt.popleft()

    def contradicts(self, rate_frd_rad_s: Vector3, t_s: float) -> bool:
        """Whether the autopilot's rate at a time, with those before it, contradicts the inertial unit."""
        if rate_frd_rad_s == self._last:  # repeated with another position
            return False
        self._last = rate_frd_rad_s
        near = [felt for felt_s, felt in self._felt if t_s - _MOMENT_S[0] <= felt_s <= t_s + _MOMENT_S[1]]
        if not near:
            return False
        size = max(map(abs, rate_frd_rad_s))
        off = max(_outside(rate, axis) for rate, *axis in zip(rate_frd_rad_s, *near, strict=True))
        is_missed = off > _TOLERANCE[0] + _TOLERANCE[1] * size
        if self._agreed < _AGREED:
            self._agreed = 0 if is_missed else self._agreed + (size > _TURNING_RAD_S)
            return False
        self._missed.append(is_missed)
        if sum(self._missed) < _MISSES:
            return False
        self._missed.clear()
        return True


def _outside(value: float, others: list[float]) -> float:
    """By how much a value is beyond the least or the greatest of others."""
    return max(min(others) - value, value - max(others))
