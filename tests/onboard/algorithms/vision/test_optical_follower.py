"""The optical follower: a lamp drawn where a camera beside a wall would see it."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from gloc3.camera.geometry import matrix, project
from gloc3.camera.model import CameraModel
from gloc3.messages.frames import from_euler
from gloc3.messages.perception import PositionFix
from gloc3_onboard.algorithms.vision.optical_follower import FollowerSettings, OpticalFollower

CAMERA = CameraModel(width=640, height=480, focal_px=(500.0, 500.0), center_px=(319.5, 239.5))
SETTINGS = FollowerSettings(
    position_ned_m=(0.0, 0.0, -6.0), ned_from_frd=from_euler(0.0, -0.5, 0.3), lever_frd_m=(0.0, 0.0, -0.1)
)
NED_FROM_RDF = matrix(SETTINGS.ned_from_frd) @ matrix(CAMERA.frd_from_rdf)
PERIOD_S = 0.1
Picture = NDArray[np.uint8]
Place = tuple[float, float, float]


def place(number: int) -> Place:
    """The lamp's way: half a metre a second."""
    return (8.0 + 0.02 * number, 2.0 + 0.04 * number, -2.0 + 0.01 * number)


NOISE = np.random.default_rng(0).normal(30.0, 3.0, (480, 640))


def seen(*lamps: Place, seed: int = 0) -> Picture:
    """A dark picture with lamps in it."""
    picture = np.roll(NOISE, 7 * seed + 1, axis=1)
    for lamp in lamps:
        rdf = (np.array([lamp]) - np.array(SETTINGS.position_ned_m)) @ NED_FROM_RDF
        column, row = project(CAMERA, rdf)[0]
        left, top = round(column) - 8, round(row) - 8
        rows, columns = np.mgrid[top : top + 17, left : left + 17]
        glow = 600.0 * np.exp(-((columns - column) ** 2 + (rows - row) ** 2) / (2.0 * 1.7**2))
        picture[top : top + 17, left : left + 17] += glow
    return np.clip(picture, 0.0, 255.0).astype(np.uint8)


class Watch:
    """Feeds pictures at a steady rate and keeps the last fix."""

    def __init__(self) -> None:
        self.follower = OpticalFollower(CAMERA, SETTINGS)
        self.count = 0

    def poll(self, picture: Picture | None = None, down_m: float | None = None) -> PositionFix:
        lamp = place(self.count)
        given = seen(lamp, seed=self.count) if picture is None else picture
        fix = self.follower.update(given, self.count * PERIOD_S, lamp[2] if down_m is None else down_m, 0.05)
        assert np.isfinite([*fix.position_ned_m, *fix.covariance]).all()
        self.count += 1
        return fix

    def looks(self, count: int) -> PositionFix:
        for _ in range(count):
            fix = self.poll()
        return fix


def error_m(fix: PositionFix, number: int) -> float:
    return math.dist(fix.position_ned_m, place(number))


def test_the_lamp_is_placed_where_the_line_of_sight_meets_its_height() -> None:
    watch = Watch()
    assert [watch.poll().reason for _ in range(2)] == ["a light appears"] * 2
    fix = watch.looks(8)
    assert fix.is_valid
    assert error_m(fix, 9) < 0.02
    assert fix.lever_frd_m == (0.0, 0.0, -0.1)
    spread = np.linalg.eigvalsh(np.array(fix.covariance).reshape(3, 3))
    assert spread[0] == pytest.approx(spread[1])
    assert math.sqrt(spread[0]) < 0.01
    assert 0.05 < math.sqrt(spread[2]) < 0.2


def test_errors_of_the_height_lie_along_the_line_of_sight_as_the_covariance_says() -> None:
    watch, random = Watch(), np.random.default_rng(5)
    watch.looks(5)
    squares = []
    for _ in range(40):
        number = watch.count
        fix = watch.poll(down_m=place(number)[2] + random.normal(0.0, 0.05))
        error = np.array(fix.position_ned_m) - np.array(place(number))
        squares.append(error @ np.linalg.solve(np.array(fix.covariance).reshape(3, 3), error) / 3.0)
    assert 0.2 < np.mean(squares) < 1.5


def test_without_a_height_only_the_direction_is_told() -> None:
    watch = Watch()
    watch.looks(5)
    fix = watch.poll(down_m=math.nan)
    spread = np.linalg.eigvalsh(np.array(fix.covariance).reshape(3, 3))
    assert fix.is_valid
    assert math.sqrt(spread[2]) == pytest.approx(10.0)
    assert math.sqrt(spread[0]) < 0.02


def test_a_second_light_far_off_is_not_followed_and_one_close_by_gives_no_position() -> None:
    watch = Watch()
    watch.looks(5)
    other = (9.0, 4.0, -1.0)
    fix = watch.poll(seen(place(5), other))
    assert fix.is_valid
    assert error_m(fix, 5) < 0.05
    x, y, z = place(6)
    assert watch.poll(seen((x, y, z), (x, y + 0.16, z))).reason == "two lights"
    assert watch.looks(1).is_valid


def test_two_lights_at_the_begin_give_no_position_until_one_is_gone() -> None:
    watch = Watch()
    for number in range(4):
        assert watch.poll(seen(place(number), (9.0, 4.0, -1.0))).reason == "two lights"
    assert not watch.looks(2).is_valid
    assert watch.looks(1).is_valid


def test_the_loss_of_sight_is_told_and_the_lamp_is_found_again() -> None:
    watch = Watch()
    watch.looks(5)
    reasons = [watch.poll(seen(seed=100 + number)).reason for number in range(30)]
    assert reasons[0] == "no light in sight"
    assert "lost for" in reasons[10]
    assert not watch.poll().is_valid
    fix = watch.looks(2)
    assert fix.is_valid
    assert error_m(fix, watch.count - 1) < 0.02


def test_after_a_second_out_of_sight_one_light_is_not_the_lamp_until_it_is_seen_three_times() -> None:
    watch = Watch()
    watch.looks(6)
    for number in range(10):
        watch.poll(seen(seed=100 + number))
    x, y, z = place(watch.count)
    assert watch.poll(seen((x, y + 1.5, z))).reason.startswith("a light appears")
    assert not watch.looks(3).is_valid
    assert watch.looks(1).is_valid


@pytest.mark.parametrize(
    ("picture", "reason"),
    [
        (np.zeros((480, 640), np.uint8), "no light in sight"),
        (np.full((480, 640), 255, np.uint8), "no light in sight"),
        (np.zeros((480, 752), np.uint8), "752 x 480"),
        (np.zeros((480, 640), np.float32), "not a picture of grey bytes"),
    ],
)
def test_a_bad_picture_says_why_and_the_next_one_is_good_again(picture: Picture, reason: str) -> None:
    watch = Watch()
    watch.looks(5)
    fix = watch.poll(picture)
    assert not fix.is_valid
    assert reason in fix.reason
    assert watch.poll().is_valid


def test_pictures_of_the_past_and_repeated_ones_are_turned_down() -> None:
    watch = Watch()
    watch.looks(6)
    assert watch.follower.update(seen(place(1)), 0.1, -2.0, 0.05).reason == "the picture is not newer than the last"
    again = seen(place(6), seed=6)
    assert watch.poll(again).is_valid
    assert watch.poll(again).reason == "the picture is the last one again"
    assert watch.poll().is_valid
