"""The stereo odometer in short flights through the simulated hold, and on real pictures that are made to move."""

import numpy as np
import pytest
from tests.data_folders import PICTURES
from tests.onboard.algorithms.vision.flights import fly, inspection
from tests.onboard.algorithms.vision.moved_rest import drive, rectified
from tests.onboard.algorithms.vision.trial import Trial, constant, follow, zero

from gloc3.evaluation.metrics import TrajectoryAlignment, evaluate
from gloc3.evaluation.trajectory import Trajectory
from gloc3_onboard.algorithms.odometry.chain import OdometryChain
from gloc3_onboard.algorithms.vision.mono_motion import MonoTracker
from gloc3_onboard.algorithms.vision.stereo_odometry import StereoOdometer
from gloc3_sitl.world.rig import FRONT_LEFT

pytestmark = pytest.mark.thorough

EUROC = PICTURES / "euroc_rest"


def share(estimate: Trajectory, truth: Trajectory) -> float:
    return 100.0 * evaluate(estimate, truth, TrajectoryAlignment.ORIGIN).absolute_share


@pytest.fixture(scope="module")
def path() -> Trajectory:
    """Six metres of an inspection, every second picture of it."""
    return inspection(3).select(slice(0, 160, 2))


def test_a_flight_in_the_hold_is_told_to_half_a_percent_and_the_controls_are_not(path: Trajectory) -> None:
    trial = Trial(path, fly(path, "hold", 3))
    assert not trial.reasons
    assert share(trial.estimate, trial.truth) < 0.5
    assert 0.5 < np.mean(trial.squares) < 9.0
    assert share(zero(path), path) > 20.0
    assert share(constant(path, 15), path) > 20.0


def test_a_key_frame_lasts_only_while_enough_of_it_is_seen_for_a_few_centimetres() -> None:
    turning = inspection(6).select(slice(1030, 1180, 2))
    trial = Trial(turning, fly(turning, "hold", 6))
    assert not trial.reasons
    assert max(trial.wrong_m) < 0.04


def test_lamps_dust_blur_and_jumps_of_the_exposure_are_stood(path: Trajectory) -> None:
    short = path.select(slice(0, 60))
    trial = Trial(short, fly(short, "hold_hard", 3))
    assert trial.reasons.total() <= 3
    assert share(trial.estimate, trial.truth) < 1.5


def test_one_camera_tells_the_turns_of_a_flight_to_a_tenth_of_a_degree(path: Trajectory) -> None:
    tracker, slow, off_deg = MonoTracker(FRONT_LEFT), path.select(slice(0, 80, 2)), []
    for n, pair in enumerate(fly(slow, "hold", 3)):
        motion = tracker.update(pair.left, pair.t_s)
        assert motion.reason == ("" if n else "the first picture")
        true = slow.world_from_body[n - 1].T @ slow.world_from_body[n]
        cosine = (np.trace(true.T @ motion.rotation) - 1.0) / 2.0
        off_deg += [np.degrees(np.arccos(min(cosine, 1.0)))] if n else []
    assert np.sqrt(np.mean(np.square(off_deg))) < 0.1


@pytest.mark.outside
def test_real_pictures_that_are_made_to_move_give_the_speed_that_they_have() -> None:
    left, right, *_ = rectified(EUROC)
    odometer, chain = StereoOdometer(left, right), OdometryChain()
    times, places = [], []
    for t_s, one, other in drive(EUROC, np.array([0.2, 0.0, 0.0]), every=8):
        place = follow(chain, odometer.update(one, other, t_s))
        times.append(t_s)
        places.append(place)
    speed = (places[-1] - places[0]) / (times[-1] - times[0])
    assert np.linalg.norm(speed) == pytest.approx(0.2, rel=0.03)
    assert speed[1] == pytest.approx(0.2, rel=0.03)
