"""The stereo odometer before a wall: what it tells of a motion, and of pictures that cannot be used."""

from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from tests.onboard.algorithms.vision.trial import follow
from tests.onboard.algorithms.vision.wall import HEIGHT, WIDTH, cameras, poll

from gloc3.messages.perception import UNKNOWN_VARIANCE
from gloc3_onboard.algorithms.odometry.chain import OdometryChain
from gloc3_onboard.algorithms.vision.features import FeatureMatcher, MatcherOptions
from gloc3_onboard.algorithms.vision.picture import Picture
from gloc3_onboard.algorithms.vision.stereo_motion import BEGUN, KeyFrameMotion, MotionOptions
from gloc3_onboard.algorithms.vision.stereo_odometry import StereoOdometer
from gloc3_onboard.algorithms.vision.stereo_rig import StereoRig

STEP_M = 0.02
RATE_HZ = 15.0


def walk(odometer: StereoOdometer, first: int, last: int) -> list[KeyFrameMotion]:
    """Steps to the right, one a picture."""
    return [odometer.update(*poll(STEP_M * n, seed=n), n / RATE_HZ) for n in range(first, last)]


def test_steps_along_a_wall_are_told_in_metres_with_an_honest_deviation() -> None:
    motions = walk(StereoOdometer(*cameras()), 0, 30)
    chain = OdometryChain()
    places = np.array([follow(chain, motion) for motion in motions])
    assert motions[0].reason == BEGUN
    assert all(motion.is_valid for motion in motions[1:])
    np.testing.assert_allclose(places[:, 1], STEP_M * np.arange(30), atol=0.01)
    assert np.abs(places[:, [0, 2]]).max() < 0.012
    for n, motion in enumerate(motions[1:], 1):
        wanted = np.array([0.0, STEP_M * n - RATE_HZ * STEP_M * motion.reference_t_s, 0.0])
        assert np.linalg.norm(motion.position_m - wanted) < 4.0 * np.sqrt(np.trace(motion.covariance[:3, :3]))
        assert np.linalg.eigvalsh(motion.covariance).min() > 0.0


def test_points_keep_their_numbers_while_they_are_seen() -> None:
    matcher = FeatureMatcher(StereoRig(*cameras()))
    before = matcher.update(*poll(0.0), 0.0)
    after = matcher.update(*poll(STEP_M, seed=1), 0.1)
    _, one, other = np.intersect1d(before.ids, after.ids, return_indices=True)
    assert len(one) > 0.8 * len(before.ids)
    moved = before.pixels[one] - after.pixels[other]
    assert np.median(moved, axis=0) == pytest.approx([2.0, 0.0], abs=0.05)
    assert np.median(before.pixels - before.right_pixels, axis=0) == pytest.approx([15.0, 0.0], abs=0.05)


Spoil = Callable[[Picture, Picture], tuple[Picture, Picture]]

BAD: dict[str, tuple[Spoil, str]] = {
    "black": (lambda left, right: (left * 0, right * 0), "left: the picture is black"),
    "white right": (lambda left, right: (left, right * 0 + 255), "right: the picture is white"),
    "grey": (lambda left, right: (left * 0 + 90, right * 0 + 90), "nothing but one grey"),
    "small": (lambda left, right: (left[::2, ::2], right[::2, ::2]), "the picture is 160 x 120"),
    "colour": (lambda left, right: (np.dstack([left] * 3), np.dstack([right] * 3)), "not grey"),
    "noise": (lambda left, right: (hiss(1), hiss(2)), "points"),
    "another scene": (lambda left, right: (left[::-1].copy(), right[::-1].copy()), "points"),
    "other pair": (lambda left, right: (left, poll(0.0, down_m=1.0)[1]), "does not show what"),
    "torn": (lambda left, right: (torn(left), torn(right)), "a jump"),
}


def hiss(seed: int) -> Picture:
    return np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8)


def torn(picture: Picture) -> Picture:
    """The lower three quarters moved to the side, as by a lost line."""
    corrupted = picture.copy()
    corrupted[HEIGHT // 4 :] = np.roll(picture[HEIGHT // 4 :], WIDTH // 3, axis=1)
    return corrupted


@pytest.mark.parametrize("name", BAD)
def test_a_bad_picture_is_told_and_the_next_good_one_goes_on(name: str) -> None:
    corrupt, text = BAD[name]
    odometer, chain = StereoOdometer(*cameras()), OdometryChain()
    for motion in walk(odometer, 0, 5):
        follow(chain, motion)
    bad = odometer.update(*corrupt(*poll(STEP_M * 5, seed=5)), 5 / RATE_HZ)
    assert not bad.is_valid
    assert text in bad.reason
    assert bad.quality == 0.0
    follow(chain, bad)
    good = walk(odometer, 6, 8)
    assert all(motion.is_valid for motion in good)
    for motion in good:
        place = follow(chain, motion)
    assert place[1] == pytest.approx(7 * STEP_M, abs=0.005)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.6, 0.7])
def test_a_picture_whose_lower_part_is_an_older_one_is_right_or_told(share: float) -> None:
    odometer = StereoOdometer(*cameras())
    walk(odometer, 0, 6)
    row = round(HEIGHT * (1.0 - share))
    mixed = [
        np.vstack([new[:row], previous[row:]])
        for new, previous in zip(poll(STEP_M * 6, seed=6), poll(STEP_M * 5, seed=5), strict=True)
    ]
    motion = odometer.update(mixed[0], mixed[1], 6 / RATE_HZ)
    assert not motion.is_valid or motion.position_m[1] == pytest.approx(6 * STEP_M, abs=0.005)
    (good,) = walk(odometer, 7, 8)
    assert good.position_m[1] == pytest.approx(7 * STEP_M, abs=0.006)


def test_time_that_does_not_grow_and_pictures_that_come_again_are_told() -> None:
    odometer = StereoOdometer(*cameras())
    walk(odometer, 0, 3)
    assert odometer.update(*poll(0.06, seed=3), 1 / RATE_HZ).reason == "the time does not grow"
    assert odometer.update(*poll(0.06, seed=3), float("nan")).reason == "the time is not a number"
    assert "same picture again" in odometer.update(*poll(0.04, seed=2), 3 / RATE_HZ).reason
    (again,) = walk(odometer, 4, 5)
    assert again.is_valid
    may = StereoOdometer(*cameras(), MatcherOptions(may_repeat=True))
    walk(may, 0, 3)
    assert may.update(*poll(0.04, seed=2), 3 / RATE_HZ).is_valid


def test_after_a_long_gap_there_is_a_new_key_frame() -> None:
    odometer = StereoOdometer(*cameras())
    walk(odometer, 0, 5)
    back = odometer.update(*poll(1.0, seed=50), 50 / RATE_HZ)
    assert back.reason == BEGUN
    assert back.reference_t_s == back.t_s
    assert back.covariance.diagonal().min() >= UNKNOWN_VARIANCE
    (on,) = walk(odometer, 51, 52)
    assert on.is_valid
    assert on.position_m[1] == pytest.approx(STEP_M, abs=0.005)


def test_missing_pictures_do_not_matter() -> None:
    odometer, chain = StereoOdometer(*cameras()), OdometryChain()
    for n in (0, 1, 2, 5, 6, 11, 12):
        place = follow(chain, odometer.update(*poll(STEP_M * n, seed=n), n / RATE_HZ))
    assert place[1] == pytest.approx(12 * STEP_M, abs=0.005)


def test_a_calibration_that_does_not_fit_is_told() -> None:
    left, right = cameras()
    lower = msgspec.structs.replace(right, center_px=(right.center_px[0], right.center_px[1] + 4.0))
    motions = walk(StereoOdometer(left, lower), 0, 5)
    assert not any(motion.is_valid for motion in motions)
    assert "the calibration does not fit: matches are 4.0 pixels off" in motions[0].reason


def test_nothing_is_ever_not_a_number() -> None:
    odometer = StereoOdometer(*cameras())
    for n in range(12):
        pair = poll(STEP_M * n, seed=n) if n % 3 else (hiss(n), hiss(n + 1))
        motion = odometer.update(*pair, n / RATE_HZ)
        numbers = (motion.position_m, motion.rotation, motion.covariance, motion.quality)
        assert all(np.isfinite(each).all() for each in numbers)
        assert motion.is_valid == (not motion.reason)


def test_steps_of_a_fifth_of_the_picture_are_followed_from_the_first_on() -> None:
    odometer, chain = StereoOdometer(*cameras(), motion=MotionOptions(std_max_m=0.3)), OdometryChain()
    for n in range(6):
        motion = odometer.update(*poll(0.6 * n, seed=n), 0.5 * n)
        place = follow(chain, motion)
        assert motion.is_valid or n == 0, motion.reason
    assert place[1] == pytest.approx(3.0, abs=0.05)
