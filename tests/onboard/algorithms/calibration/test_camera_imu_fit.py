"""A camera on an inertial unit with known place and time: right within bounds and within what is claimed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.onboard.algorithms.calibration.motions import HAND, Hand
from tests.onboard.algorithms.calibration.rendered import CAMERA, CHECKERBOARD
from tests.onboard.algorithms.calibration.scenes import seen

from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.boards import Floats
from gloc3_onboard.algorithms.calibration.camera_imu_fit import CameraImuFit, CameraMotion, fit_camera_imu, motion_of
from gloc3_onboard.algorithms.calibration.gyro_turns import GyroTurns
from gloc3_onboard.algorithms.calibration.lens_fit import board_pose

OFFSET_S = 0.0123


def camera_motion(hand: Hand, seconds: float = 14.0, offset_s: float = OFFSET_S) -> CameraMotion:
    times_s = np.arange(0.0, seconds, 1.0 / 15.0)
    views = seen(CAMERA, CHECKERBOARD, list(hand.poses(times_s + offset_s)), 0.1, hand.seed)
    return motion_of(times_s.tolist(), np.array([board_pose(CAMERA, view) for view in views]))


def fitted(hand: Hand) -> CameraImuFit:
    return fit_camera_imu(camera_motion(hand), hand.samples(np.arange(-1.5, 16.0, 0.01)))


def test_place_turn_and_time_are_right_within_what_is_claimed() -> None:
    sigmas = []
    for seed in range(2):
        hand = HAND._replace(seed=seed)
        fit = fitted(hand)
        turn = (fit.camera_from_imu * hand.camera_from_imu.inv()).as_rotvec()
        assert fit.offset_s == pytest.approx(OFFSET_S, abs=5e-4)
        assert np.degrees(np.linalg.norm(turn)) < 0.15
        assert fit.imu_in_camera_m == pytest.approx(hand.imu_in_camera_m, abs=4e-3)
        assert fit.gravity_m_s2 == pytest.approx(9.807, rel=0.005)
        sigmas += [(fit.offset_s - OFFSET_S) / fit.offset_std_s, *(turn / fit.turn_std_rad)]
        sigmas += ((fit.imu_in_camera_m - hand.imu_in_camera_m) / fit.place_std_m).tolist()
    assert np.abs(sigmas).max() < 4.0
    assert 0.3 < np.sqrt(np.mean(np.square(sigmas))) < 1.6


def test_a_turn_about_one_axis_does_not_tell_the_place() -> None:
    class OneAxis(Hand):
        def poses(self, times_s: Floats) -> Floats:
            turned = Rotation.from_rotvec(np.outer(np.sin(4.0 * times_s), [0.0, 0.0, 0.4]))
            whole = (turned * Rotation.from_rotvec(self.mean[:3])).as_rotvec()
            return np.column_stack((whole, np.tile(self.mean[3:], (len(times_s), 1))))

    fit = fitted(OneAxis(*HAND))
    assert fit.spreads_rad_s[1] < 0.1 < fit.spreads_rad_s[0]
    assert fit.place_std_m[2] > 5.0 * fit.place_std_m[:2].max()


def test_too_few_pictures_are_refused() -> None:
    motion = camera_motion(HAND, seconds=1.5)
    with pytest.raises(Refused, match="pictures with a board are too few: 30 are the least"):
        fit_camera_imu(motion, HAND.samples(np.arange(-1.5, 4.0, 0.01)))


def test_data_that_do_not_overlap_are_refused() -> None:
    with pytest.raises(Refused, match=r"the data overlap for 0.0 s, less 0.5 s at either end: 3 s are the least"):
        fit_camera_imu(camera_motion(HAND), HAND.samples(np.arange(100.0, 110.0, 0.01)))


def test_turns_of_a_gyro_are_exact_for_a_constant_rate_at_any_time() -> None:
    times_s, rate = np.arange(0.0, 2.0, 0.01), np.array([0.3, -0.2, 0.5])
    turns = GyroTurns(times_s, np.tile(rate + 0.1, (len(times_s), 1)), np.full(3, 0.1))
    asked = np.array([0.0, 0.504, 1.2345, 1.9])
    assert turns.at(asked).as_rotvec() == pytest.approx(asked[:, None] * rate, abs=1e-9)
