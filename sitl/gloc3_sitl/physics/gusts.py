"""Turbulence near the ground: gusts of Dryden's spectra, by the height over the ground."""

from math import exp, hypot, sqrt
from typing import Final

from gloc3.messages.frames import Vector3
from gloc3_sitl.physics.wind import Wind
from gloc3_sitl.sensors.noise import normals

_FOOT_M: Final = 0.3048
_LOWEST_M, _HIGHEST_M = 10.0 * _FOOT_M, 1000.0 * _FOOT_M
"""Where the model holds; lower and higher the air is as at its ends."""
_SLOWEST_M_S: Final = 0.5
"""A vehicle that moves with the air passes its gusts no slower."""
_TWO: Final = sqrt(2.0)
_THREE: Final = sqrt(3.0)


class Gusts:
    """Gusts along, across and down by MIL-F-8785C (section 3.7.3.4), up to 1000 ft over the ground.

    Across and down, Dryden's second-order spectrum is the sum of a first-order lag and a second lag in series.

    Args:
        seed: random seed.
    """

    def __init__(self, seed: int) -> None:
        self._draw: Final = normals(seed, "gusts")
        self._first = [self._draw() for _ in range(3)]
        self._second = [0.0, 0.0, 0.0]

    def step(self, wind: Wind, height_m: float, airspeed_m_s: float, period_s: float) -> Vector3:
        """Gust velocity after a period, on top of the mean wind, NED in m/s.

        Args:
            wind: mean wind, and the wind speed at 20 ft that scales the gusts.
            height_m: height over the ground.
            airspeed_m_s: speed through the gusts.
            period_s: time since the last step; short compared with the time to pass a gust, at least 0.2 s.
        """
        height_ft = min(max(height_m, _LOWEST_M), _HIGHEST_M) / _FOOT_M
        rough = 0.177 + 0.000823 * height_ft
        along_m, down_m = height_ft / rough**1.2 * _FOOT_M, height_ft * _FOOT_M
        down_m_s = 0.1 * wind.gust_m_s
        along_m_s = down_m_s / rough**0.4
        share = max(airspeed_m_s, _SLOWEST_M_S) * period_s
        u = along_m_s * self._lag(0, share / along_m)
        v = along_m_s * self._lags(1, share / along_m)
        w = down_m_s * self._lags(2, share / down_m)
        n, e, _ = wind.velocity_ned_m_s
        size = hypot(n, e)
        north, east = (n / size, e / size) if size > 0.0 else (1.0, 0.0)
        return (north * u - east * v, east * u + north * v, w)

    def _lag(self, axis: int, share: float) -> float:
        """First-order, of variance 1."""
        keep = exp(-share)
        self._first[axis] = keep * self._first[axis] + sqrt(1.0 - keep * keep) * self._draw()
        return self._first[axis]

    def _lags(self, axis: int, share: float) -> float:
        """`(1 + sqrt(3) T s) / (1 + T s)^2`, of variance 1."""
        before = self._first[axis]
        middle = 0.5 * (before + self._lag(axis, share))
        self._second[axis] += (1.0 - exp(-share)) * (middle - self._second[axis])
        return (_THREE * self._first[axis] + (1.0 - _THREE) * self._second[axis]) / _TWO
