"""A flight in the simulated hold with a chosen heading, and what the gyros of it measure."""

from collections.abc import Callable

import numpy as np
from tests.onboard.algorithms.vision.flights import NED_FROM_LOCAL, RATE_HZ

from gloc3.camera.geometry import matrix
from gloc3.evaluation.trajectory import Array, Trajectory
from gloc3.messages.frames import Vector3, from_euler
from gloc3_onboard.algorithms.odometry.gyro_turn import GyroTurn

GYRO_HZ = 200.0
BIAS_RAD_S = np.array([0.02, -0.01, 0.03])
NOISE_RAD_S = 0.002

Heading = Callable[[Array], Array]
"""Of times (n,) in s: headings in rad."""


def flown(heading: Heading, duration_s: float, speed_m_s: float = 0.5) -> Trajectory:
    """Level and straight along the hold, looking where the heading says."""
    t_s = np.arange(int(duration_s * RATE_HZ)) / RATE_HZ
    local = np.column_stack([3.0 + speed_m_s * t_s, np.full(len(t_s), 3.0), np.full(len(t_s), 1.8)])
    turned = np.array([matrix(from_euler(0.0, 0.0, yaw)) for yaw in heading(t_s).tolist()])
    return Trajectory(t_s=t_s, position_m=local @ NED_FROM_LOCAL.T, world_from_body=turned)


class Gyros:
    """Samples of an inertial unit with a bias and noise, fed in the order of time."""

    def __init__(self, heading: Heading, duration_s: float, bias_rad_s: Array = BIAS_RAD_S) -> None:
        times = np.arange(-0.1, duration_s, 1.0 / GYRO_HZ)
        rates = np.random.default_rng(11).normal(0.0, NOISE_RAD_S, (len(times), 3)) + bias_rad_s
        rates[:, 2] += np.gradient(heading(times), times)
        self._samples: list[tuple[float, Vector3]] = [
            (t_s, (p, q, r)) for t_s, (p, q, r) in zip(times.tolist(), rates.tolist(), strict=True)
        ]
        self.turn = GyroTurn()
        """What they are fed to."""

    def feed(self, t_s: float) -> None:
        """All samples up to a time."""
        while self._samples and self._samples[0][0] <= t_s:
            self.turn.add(*self._samples.pop(0))
