"""A scanner's time against a gyro: found within what is claimed, upright and upside down."""

import numpy as np
import pytest

from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.boards import Floats
from gloc3_onboard.algorithms.calibration.laser_imu_fit import fit_laser_imu
from gloc3_onboard.algorithms.calibration.time_offset import rate_offset

OFFSET_S, BIAS = -0.037, 0.01
IMU_S = np.arange(0.0, 32.0, 0.01)


def yaw(times_s: Floats, seed: int) -> Floats:
    phases = np.random.default_rng(seed).uniform(0.0, 6.0, 3)
    waves = [
        amount * np.sin(rate * times_s + phase)
        for amount, rate, phase in zip((2.5, 0.6, 0.3), (0.3, 1.9, 5.0), phases, strict=True)
    ]
    return np.asarray(np.sum(waves, axis=0))


def data(seed: int, sign: float = 1.0) -> tuple[Floats, Floats, Floats, Floats]:
    random = np.random.default_rng([seed, 1])
    scans_s = np.arange(1.0, 30.0, 0.1)
    yaws = sign * yaw(scans_s + OFFSET_S, seed) + random.normal(0.0, 0.003, len(scans_s))
    rates = (yaw(IMU_S + 1e-4, seed) - yaw(IMU_S - 1e-4, seed)) / 2e-4
    return scans_s, yaws, IMU_S, rates + BIAS + random.normal(0.0, 0.005, len(IMU_S))


def test_time_bias_and_mount_are_right_within_what_is_claimed() -> None:
    sigmas = []
    for seed in range(4):
        fit = fit_laser_imu(*data(seed, -1.0 if seed % 2 else 1.0))
        assert fit.offset_s == pytest.approx(OFFSET_S, abs=1e-3)
        assert fit.gyro_bias_rad_s == pytest.approx(BIAS, abs=1e-3)
        assert fit.is_flipped is bool(seed % 2)
        sigmas.append((fit.offset_s - OFFSET_S) / fit.offset_std_s)
    assert np.abs(sigmas).max() < 4.0


def test_a_gyro_of_another_scale_is_shown() -> None:
    scans_s, yaws, imu_s, rates = data(0)
    fit = fit_laser_imu(scans_s, yaws, imu_s, rates / 1.05)
    assert fit.scale == pytest.approx(1.05, abs=0.005)


def test_a_few_wrong_matches_change_little() -> None:
    scans_s, yaws, imu_s, rates = data(1)
    yaws[100:] += 0.4
    yaws[200:] -= 0.3
    assert fit_laser_imu(scans_s, yaws, imu_s, rates).offset_s == pytest.approx(OFFSET_S, abs=3e-3)


@pytest.mark.parametrize(
    ("last", "said"), [(40, "40 scans that could be matched are too few: 50"), (None, "the data overlap for 0.0 s")]
)
def test_what_does_not_tell_is_refused(last: int | None, said: str) -> None:
    scans_s, yaws, imu_s, rates = data(0)
    with pytest.raises(Refused, match=said):
        fit_laser_imu(scans_s[:last], yaws[:last], imu_s + (0.0 if last else 100.0), rates)


@pytest.mark.parametrize("offset_s", [-0.2, 0.0, 0.113])
def test_the_first_guess_is_near(offset_s: float) -> None:
    one_s, other_s = np.arange(0.0, 20.0, 0.07), np.arange(-1.0, 21.0, 0.01)
    found = rate_offset(one_s, yaw(one_s + offset_s, 3), other_s, yaw(other_s, 3), 0.5)
    assert found.offset_s == pytest.approx(offset_s, abs=0.01)
    assert found.correlation > 0.99
