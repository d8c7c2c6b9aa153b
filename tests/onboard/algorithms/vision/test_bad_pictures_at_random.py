"""Anything at all as input, in any order: never not-a-number, and right again after a few good pictures."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from gloc3.messages.frames import IDENTITY, Quaternion
from gloc3.messages.perception import Odometry, PositionFix
from gloc3_onboard.algorithms.vision.ground_odometer import GroundOdometer
from gloc3_onboard.algorithms.vision.optical_follower import OpticalFollower

from .test_ground_odometer import CAMERA, HEIGHT_M, PERIOD_S, seen
from .test_optical_follower import CAMERA as TRACKER
from .test_optical_follower import SETTINGS, place
from .test_optical_follower import seen as lit

pytestmark = pytest.mark.thorough

Picture = NDArray[np.uint8]
EVENTS = 60
GOOD_AFTERWARDS = 8


def corrupted(picture: Picture, other: Picture, random: np.random.Generator) -> Picture:
    """A picture with something wrong with it."""
    kind, cut = random.integers(0, 7), int(random.integers(1, len(picture)))
    match kind:
        case 0:
            return np.zeros_like(picture)
        case 1:
            return np.full_like(picture, 255)
        case 2:
            return np.vstack((picture[:cut], other[cut:]))
        case 3:
            return picture[: len(picture) // 2]
        case 4:
            return random.integers(0, 256, picture.shape).astype(np.uint8)
        case 5:
            return np.ascontiguousarray(picture[::-1, ::-1])
        case _:
            return picture


def finite(found: Odometry | PositionFix) -> None:
    reported = found.position_m if isinstance(found, Odometry) else found.position_ned_m
    assert np.isfinite([*reported, *found.covariance, found.quality]).all()
    assert found.is_valid == (found.reason == "")


@pytest.mark.parametrize("seed", range(3))
def test_the_ground_odometer_gets_over_anything(seed: int) -> None:
    random, odometer = np.random.default_rng(seed), GroundOdometer(CAMERA)
    for number in range(EVENTS):
        t_s = PERIOD_S * number + random.choice([0.0, 0.0, 0.0, -0.3, 0.4, math.nan])
        attitude: Quaternion = (math.nan, 0.0, 0.0, 0.0) if random.random() < 0.1 else IDENTITY
        height_m = float(random.choice([HEIGHT_M, HEIGHT_M, math.nan, 0.0, -1.0, 1e9, 0.5]))
        finite(odometer.update(corrupted(seen(number), seen(80, 60), random), t_s, attitude, height_m))
    reports = []
    for number in range(GOOD_AFTERWARDS):
        t_s = PERIOD_S * (EVENTS + 10 + number)
        found = odometer.update(seen(60 + number), t_s, IDENTITY, HEIGHT_M)
        finite(found)
        reports.append(found)
    assert found.is_valid, found.reason
    first = next(each for each in reports if each.is_valid and each.reference_t_s == found.reference_t_s)
    moved_m = found.position_m[0] - first.position_m[0]
    assert moved_m == pytest.approx(HEIGHT_M / 200.0 * (len(reports) - 1 - reports.index(first)), abs=0.003)
    before = odometer.update(seen(0, 100), t_s + 2.0, IDENTITY, HEIGHT_M)
    assert not before.is_valid
    after = odometer.update(seen(4, 100), t_s + 2.0 + PERIOD_S, IDENTITY, HEIGHT_M)
    assert after.position_m[0] == pytest.approx(4 * HEIGHT_M / 200.0, rel=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_the_optical_follower_gets_over_anything(seed: int) -> None:
    random, follower = np.random.default_rng(seed), OpticalFollower(TRACKER, SETTINGS)
    for number in range(EVENTS):
        t_s = 0.1 * number + random.choice([0.0, 0.0, -0.5, 0.6, math.nan])
        lights = [place(number), (9.0, 4.0, -1.0)][: random.integers(0, 3)]
        down_m = float(random.choice([place(number)[2], math.nan, math.inf, 1e9, -1e9]))
        picture = corrupted(lit(*lights, seed=number), lit(place(3)), random)
        finite(follower.update(picture, t_s, down_m, float(random.choice([0.05, 0.0, math.nan]))))
    for number in range(30):
        fix = follower.update(lit(place(number), seed=number), 0.1 * (EVENTS + 10 + number), place(number)[2], 0.05)
        finite(fix)
    assert fix.is_valid, fix.reason
    assert math.dist(fix.position_ned_m, place(29)) < 0.1
