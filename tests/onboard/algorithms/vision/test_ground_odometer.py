"""The ground odometer on pictures of a flat floor: a moving cut of one texture is exactly what a level camera sees."""

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gloc3.camera.model import CameraModel
from gloc3.messages.frames import IDENTITY, from_euler, from_yaw, yaw_of
from gloc3.messages.perception import Odometry
from gloc3_onboard.algorithms.vision.ground_height import GroundHeight
from gloc3_onboard.algorithms.vision.ground_odometer import GroundOdometer

FOCAL_PX = 200.0
CAMERA = CameraModel(
    width=320,
    height=240,
    focal_px=(FOCAL_PX, FOCAL_PX),
    center_px=(159.5, 119.5),
    frd_from_rdf=from_euler(0.0, 0.0, math.pi / 2.0),
)
PERIOD_S = 1.0 / 15.0
HEIGHT_M = 2.0
STEP_PX = 4
Picture = NDArray[np.uint8]


def _texture() -> Picture:
    random = np.random.default_rng(3)
    fine = cv2.GaussianBlur(random.uniform(0, 255, (900, 900)).astype(np.float32), (0, 0), 2.0)
    coarse = cv2.GaussianBlur(random.uniform(0, 255, (900, 900)).astype(np.float32), (0, 0), 9.0)
    both = 128.0 + 3.0 * (fine - 127.0) + 8.0 * (coarse - 127.0)
    return np.clip(both, 0, 255).astype(np.uint8)


FLOOR = _texture()


def seen(forward_px: int, right_px: int = 0) -> Picture:
    """What the camera sees after moving so far: the top of the picture is ahead."""
    top, left = 500 - forward_px, 200 + right_px
    return FLOOR[top : top + 240, left : left + 320].copy()


class Flight:
    """Moves ahead four pixels a picture, and keeps what the odometer says."""

    def __init__(self, odometer: GroundOdometer | None = None) -> None:
        self.odometer = odometer or GroundOdometer(CAMERA)
        self.count = 0
        self.place = {0.0: 0.0}
        self.last = Odometry(source="", reference_t_s=0.0)

    @property
    def t_s(self) -> float:
        return self.count * PERIOD_S

    def step(self, picture: Picture | None = None, height_m: float = HEIGHT_M) -> Odometry:
        self.last = self.odometer.update(
            seen(STEP_PX * self.count) if picture is None else picture, self.t_s, IDENTITY, height_m
        )
        assert np.isfinite([*self.last.position_m, *self.last.covariance, *self.last.reference_from_frd]).all()
        if self.last.is_valid:
            self.place[self.t_s] = self.place[self.last.reference_t_s] + self.last.position_m[0]
        self.count += 1
        return self.last

    def steps(self, count: int) -> None:
        for _ in range(count):
            self.step()

    @property
    def error_m(self) -> float:
        """How far the last place is from where it should be; infinite where none was told."""
        moved_m = STEP_PX * (self.count - 1) * HEIGHT_M / FOCAL_PX
        return abs(self.place[(self.count - 1) * PERIOD_S] - moved_m) if self.last.is_valid else math.inf

    @property
    def is_right(self) -> bool:
        """The last place is where it should be, to 2 mm."""
        return self.error_m < 0.002


def test_a_flight_over_a_flat_floor_is_metric_and_level() -> None:
    flight = Flight()
    assert flight.step().reason == "restarts: the first picture"
    flight.steps(40)
    assert flight.is_right
    assert flight.last.is_level
    assert flight.last.quality > 0.5
    covariance = np.array(flight.last.covariance).reshape(6, 6)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert math.sqrt(covariance[0, 0]) < 0.02


def test_the_height_and_the_turn_scale_and_turn_the_motion() -> None:
    odometer = GroundOdometer(CAMERA)
    for number in range(8):
        found = odometer.update(seen(0, STEP_PX * number), number * PERIOD_S, from_yaw(1.0), 3.0)
    assert found.position_m == pytest.approx((0.0, 7 * STEP_PX * 3.0 / FOCAL_PX, 0.0), abs=0.003)
    turn = cv2.getRotationMatrix2D((159.5, 119.5), 6.0, 1.0)
    turned = cv2.warpAffine(seen(0, STEP_PX * 7), turn, (320, 240), borderMode=cv2.BORDER_WRAP)
    found = odometer.update(turned.astype(np.uint8), 8 * PERIOD_S, from_yaw(1.0 + math.radians(5.5)), 3.0)
    assert math.degrees(yaw_of(found.reference_from_frd)) == pytest.approx(6.0, abs=0.1)


@pytest.mark.parametrize(
    ("name", "picture", "reason"),
    [
        ("black", np.zeros((240, 320), np.uint8), "is black"),
        ("white", np.full((240, 320), 255, np.uint8), "is white"),
        ("of another size", np.zeros((480, 640), np.uint8), "640 x 480"),
        ("of another kind", np.zeros((240, 320), np.float32), "not grey, 8 bits"),
        ("noise", np.random.default_rng(1).integers(0, 255, (240, 320), np.uint8), "points"),
    ],
)
def test_a_bad_picture_says_so_and_the_next_good_one_bridges_it(name: str, picture: Picture, reason: str) -> None:
    flight = Flight()
    flight.steps(6)
    found = flight.step(picture)
    assert not found.is_valid, name
    assert reason in found.reason
    assert found.quality == 0.0
    flight.step()
    assert flight.is_right, flight.last.reason


def test_a_torn_picture_is_right_within_its_covariance_or_says_that_it_is_not() -> None:
    flight = Flight()
    flight.steps(6)
    torn = seen(STEP_PX * 6)
    torn[80:] = np.roll(seen(STEP_PX * 6 + 60, 37), 50, axis=1)[80:]
    found = flight.step(torn)
    assert not found.is_valid or flight.error_m < 2.0 * math.sqrt(found.covariance[0])
    assert flight.step().is_valid
    assert flight.error_m < 0.006


def test_the_same_picture_twice_is_not_rest_and_a_missing_one_is_no_loss() -> None:
    flight = Flight()
    flight.steps(6)
    assert flight.step(seen(STEP_PX * 5)).reason == "the picture is the last one again"
    flight.count += 2
    flight.step()
    assert flight.is_right, flight.last.reason


def test_pictures_of_the_past_are_turned_down_until_time_itself_has_gone_back() -> None:
    flight = Flight()
    flight.steps(10)
    for number in range(4):
        found = flight.odometer.update(seen(number), number * PERIOD_S, IDENTITY, HEIGHT_M)
        assert found.reason == "the picture is not newer than the last"
    assert "restarts" in flight.odometer.update(seen(4), 4 * PERIOD_S, IDENTITY, HEIGHT_M).reason
    assert flight.odometer.update(seen(8), 5 * PERIOD_S, IDENTITY, HEIGHT_M).is_valid


def test_without_heights_it_goes_on_by_what_it_sees_of_them_and_comes_back_by_itself() -> None:
    flight = Flight()
    flight.steps(3)
    assert flight.step(height_m=math.nan).is_valid
    reasons = []
    for number in range(8 * 15):
        flight.count += 1
        shift = STEP_PX * 4 + number % 2
        reasons.append(flight.odometer.update(seen(shift), flight.t_s, IDENTITY, math.nan).reason)
    assert not any(reasons), set(reasons)
    flight.count += 30
    assert flight.odometer.update(seen(STEP_PX * 5), flight.t_s, IDENTITY, math.nan).reason == "there is no height"
    flight.count += 1
    flight.odometer.update(seen(STEP_PX * 3), flight.t_s, IDENTITY, HEIGHT_M)
    assert flight.odometer.update(seen(STEP_PX * 4), flight.t_s + PERIOD_S, IDENTITY, HEIGHT_M).is_valid


def test_a_height_that_has_changed_unmeasured_too_often_is_none() -> None:
    height = GroundHeight(0.02, 0.007)
    height.begin(1.5)
    found = []
    for _ in range(100):
        height.rise(1.0, 0.0102)
        found.append(height.is_lost(5.0))
    assert (found[80], found[99]) == (False, True)


def test_without_an_attitude_nothing_is_told() -> None:
    found = GroundOdometer(CAMERA).update(seen(0), 0.0, (math.nan, 0.0, 0.0, 0.0), HEIGHT_M)
    assert not found.is_valid
    assert found.reason == "there is no attitude"
