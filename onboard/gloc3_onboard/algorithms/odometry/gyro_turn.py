"""Turn of the body between two pictures by its gyros, whose bias the pictures' own turns tell."""

from collections import deque
from typing import Final, NamedTuple

import numpy as np

from gloc3.camera.geometry import Array
from gloc3.messages.frames import Vector3
from gloc3_onboard.algorithms.vision.pose_fit import rotation_of, vector_of

_KEPT_S: Final = 1.5
_GAP_S: Final = 0.05
"""Longest time between two samples over which a turn is integrated, s."""
_AHEAD_S: Final = 0.02
"""Longest time from the last sample to the end of a turn, s."""
_TURN_RAD_S2: Final = 20.0
"""Change of the rate that is possible after the last sample."""
_NOISE_RAD_RTS: Final = 1e-3
"""White noise, rad/s/√Hz: several times that of a MEMS gyro, for vibration."""
_SHARE: Final = 0.02
"""Error of scale and alignment, as a share of the turn."""
_DELAY_S: Final = 0.002
"""Standard deviation of the offset between the times of pictures and samples."""
_BIAS_RAD_S: Final = 0.05
"""Standard deviation of an unknown bias: that of MEMS gyros which nobody has calibrated."""
_BIAS_LEAST_RAD_S: Final = 2e-4
_BIAS_WALK_RAD_S_RTS: Final = 1e-4
"""How much the bias changes, per root of a second."""


class InertialTurn(NamedTuple):
    """A turn of the body."""

    rotation: Array
    """Begin from end, FRD, (3, 3)."""
    variance_rad2: float
    """Of each component of its rotation vector."""


class GyroTurn:
    """Integrates the rates of an inertial unit, on FRD axes, between any two moments of the last second."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, Vector3]] = deque()
        self.bias_rad_s: Array = np.zeros(3)
        """What is subtracted from the rates, (3,)."""
        self._bias_variance = _BIAS_RAD_S**2

    @property
    def bias_std_rad_s(self) -> float:
        """Standard deviation of the bias, of each axis."""
        return float(np.sqrt(self._bias_variance))

    def add(self, t_s: float, rate_frd_rad_s: Vector3) -> None:
        """Takes in one sample; one that is not later than the last begins anew."""
        samples = self._samples
        if samples and t_s <= samples[-1][0]:
            samples.clear()
        samples.append((t_s, rate_frd_rad_s))
        while samples[0][0] < t_s - _KEPT_S:
            samples.popleft()

    def turn(self, begin_s: float, end_s: float) -> InertialTurn | None:
        """The turn between two times; None where the samples do not cover them."""
        found = self._integrated(begin_s, end_s)
        if found is None:
            return None
        rotation, variance = found
        return InertialTurn(rotation, variance + self._bias_variance * (end_s - begin_s) ** 2)

    def learn(self, begin_s: float, end_s: float, seen: Array, variance_rad2: float) -> None:
        """Learns the bias from a turn that pictures tell: soonest at rest, where the gyros have no other error.

        Args:
            begin_s: begin of the turn.
            end_s: its end.
            seen: the turn, begin from end, FRD, (3, 3).
            variance_rad2: of each component of its rotation vector.
        """
        found = self._integrated(begin_s, end_s)
        if found is None:
            return
        # A scalar Kalman filter for each axis: the turns differ by the bias's error times the time.
        after_s = end_s - begin_s
        error_rad_s = vector_of(seen.T @ found[0]) / after_s
        self._bias_variance += _BIAS_WALK_RAD_S_RTS**2 * after_s
        gain = self._bias_variance / (self._bias_variance + (found[1] + variance_rad2) / after_s**2)
        self.bias_rad_s = self.bias_rad_s + gain * error_rad_s
        self._bias_variance = max((1.0 - gain) * self._bias_variance, _BIAS_LEAST_RAD_S**2)

    def _integrated(self, begin_s: float, end_s: float) -> tuple[Array, float] | None:
        """Turn, and the variance of each component without that of the bias."""
        samples = self._samples
        if not samples or not samples[0][0] <= begin_s < end_s <= samples[-1][0] + _AHEAD_S:
            return None
        times = np.array([t_s for t_s, _ in samples])
        first, last = np.searchsorted(times, (begin_s, end_s))
        if float(np.diff(times[max(first - 1, 0) : last + 1]).max(initial=0.0)) > _GAP_S:
            return None
        knots = np.array([begin_s, *times[(times > begin_s) & (times < end_s)], end_s])
        given = np.array([rate for _, rate in samples])
        rates = np.column_stack([np.interp(knots, times, given[:, axis]) for axis in range(3)]) - self.bias_rad_s
        rotation = np.eye(3)
        for rate, after_s in zip(0.5 * (rates[1:] + rates[:-1]), np.diff(knots).tolist(), strict=True):
            rotation = rotation @ rotation_of(rate * after_s)
        beyond_s = max(end_s - float(times[-1]), 0.0)
        change = float(np.linalg.norm(rates[-1] - rates[0]))
        variance = (
            _NOISE_RAD_RTS**2 * (end_s - begin_s)
            + (_SHARE * float(np.linalg.norm(vector_of(rotation)))) ** 2
            + (_DELAY_S * change) ** 2
            + (0.5 * _TURN_RAD_S2 * beyond_s**2) ** 2
        )
        return rotation, variance
