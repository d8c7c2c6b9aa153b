"""What the fusion makes of single samples of the inertial unit."""

import pytest

from gloc3_onboard.fusion.imu_watch import ImuWatch
from gloc3_onboard.fusion.trust import Trust


def test_a_jolt_between_two_samples_leaves_the_velocity_in_doubt() -> None:
    watch, trust = ImuWatch(), Trust("imu", 1.0)
    still, struck = (0.0, 0.0, -9.8), (0.0, 0.0, -60.0)
    doubts = []
    for count, force in enumerate((still, still, struck, still, still)):
        mean = watch.take((0.0, 0.0, 0.0), force, 0.01 * count, 0.01 * count, trust)
        doubts.append(mean.jolt_m_s if mean is not None else None)
    assert doubts == [0.0, 0.0, pytest.approx(0.25, abs=0.01), pytest.approx(0.25, abs=0.01), 0.0]


def test_a_sample_that_is_turned_down_leaves_the_velocity_in_doubt_too() -> None:
    watch, trust = ImuWatch(), Trust("imu", 1.0)
    for count in range(3):
        watch.take((0.0, 0.0, 0.0), (0.0, 0.0, -9.8), 0.01 * count, 0.01 * count, trust)
    assert watch.take((0.0, 0.0, 0.0), (0.0, 0.0, -120.0), 0.03, 0.03, trust) is None
    mean = None
    for count in range(4, 30):
        mean = mean or watch.take((0.0, 0.0, 0.0), (0.0, 0.0, -9.8), 0.01 * count, 0.01 * count, trust)
    assert mean is not None
    assert mean.jolt_m_s > 0.5
