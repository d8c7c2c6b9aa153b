"""Turns of an inertial unit by its gyros, between any two times."""

from typing import Any

import numpy as np

from gloc3_onboard.algorithms.calibration.boards import Floats


class GyroTurns:
    """The integral of a gyro: rotations from its begin on, at any time.

    Args:
        times_s: of the samples, increasing, (n,).
        rates_rad_s: angular velocities, (n, 3).
        bias_rad_s: what is subtracted, (3,).
    """

    def __init__(self, times_s: Floats, rates_rad_s: Floats, bias_rad_s: Floats) -> None:
        from scipy.spatial.transform import Rotation

        self._times_s, self._rates = times_s, rates_rad_s - bias_rad_s
        steps = 0.5 * (self._rates[1:] + self._rates[:-1]) * np.diff(times_s)[:, None]
        found = Rotation.from_rotvec(np.concatenate((np.zeros((1, 3)), steps)))
        reach = 1
        while reach < len(found):  # each becomes the product of all before it: prefix products by doubling
            found = Rotation.concatenate([found[:reach], found[:-reach] * found[reach:]])
            reach *= 2
        self._turns = found

    def at(self, times_s: Floats) -> Any:
        """`begin_from_body` at these times, as scipy's `Rotation`."""
        from scipy.spatial.transform import Rotation

        before = np.clip(np.searchsorted(self._times_s, times_s, "right") - 1, 0, len(self._times_s) - 2)
        since = (times_s - self._times_s[before])[:, None]
        span = np.diff(self._times_s)[before][:, None]
        rate = self._rates[before] + 0.5 * since / span * (self._rates[before + 1] - self._rates[before])
        return self._turns[before] * Rotation.from_rotvec(rate * since)
