"""Points are followed exactly while the picture turns and grows, and a stereo pair that leans fast tells its motion."""

from math import cos, pi, radians, sin

import cv2
import numpy as np
import pytest
from tests.onboard.vision.flights import fly
from tests.onboard.vision.trial import Trial

from gloc3.camera_geometry import matrix
from gloc3.frames import from_euler
from gloc3.trajectory import Array, Trajectory
from gloc3_onboard.vision.corners import GridCorners
from gloc3_onboard.vision.lucas_kanade import PatchTracker
from gloc3_onboard.vision.picture import LightEvener, Picture
from gloc3_onboard.vision.point_tracker import PointTracker

WIDTH, HEIGHT, STEP_S = 640, 480, 1.0 / 15.0


def texture() -> Picture:
    random = np.random.default_rng(3)
    blots = cv2.GaussianBlur(random.uniform(0.0, 255.0, (2 * HEIGHT, 2 * WIDTH)), (0, 0), 2.5)
    painted: Picture = np.clip((blots - 127.5) * 5.0 + 127.5, 0.0, 255.0).astype(np.uint8)
    return painted


def seen(turn_deg: float, growth: float) -> Array:
    """Picture from texture, (2, 3): turned and grown around the middle."""
    c, s = growth * cos(radians(turn_deg)), growth * sin(radians(turn_deg))
    return np.array([[c, -s, WIDTH / 2 - c * WIDTH + s * HEIGHT], [s, c, HEIGHT / 2 - s * WIDTH - c * HEIGHT]])


@pytest.mark.parametrize(("turn_deg", "growth"), [(2.0, 1.0), (-3.0, 1.0), (0.0, 1.02), (1.5, 0.98)])
def test_points_are_followed_to_a_tenth_of_a_pixel_while_the_picture_turns_and_grows(
    turn_deg: float, growth: float
) -> None:
    points, light = PointTracker(GridCorners(40), PatchTracker(), 4), LightEvener()
    for number in range(8):
        to_now = seen(turn_deg * number, growth**number)
        picture = light.even(cv2.warpAffine(texture(), to_now, (WIDTH, HEIGHT)).astype(np.uint8))
        if number == 0:
            points.anchor(picture, points.candidates(picture))
            first = cv2.invertAffineTransform(to_now)
            begin = points.pixels @ first[:, :2].T + first[:, 2]
        else:
            assert points.follow(picture, STEP_S) == ""
    off_px = np.linalg.norm(points.pixels - (begin[points.ids] @ to_now[:, :2].T + to_now[:, 2]), axis=1)
    assert len(points.ids) > 0.6 * len(begin)
    assert np.median(off_px) < 0.1


def test_a_vehicle_that_leans_by_eighty_degrees_a_second_is_followed_all_the_way() -> None:
    t_s = np.arange(24, dtype=np.float64) * STEP_S
    roll = radians(12.0) * np.sin(np.clip(t_s - 0.4, 0.0, 0.9) * 2.0 * pi / 0.9)
    place = np.array([3.0, -1.0, -2.0]) + t_s[:, None] * [0.0, -0.3, 0.0]
    turns = np.array([matrix(from_euler(angle, 0.02, 0.0)) for angle in roll])
    path = Trajectory(t_s=t_s, position_m=place, world_from_body=turns)
    trial = Trial(path, fly(path, "hold", 5))
    assert not trial.reasons
    moved = turns[0].T @ (place[-1] - place[0])
    np.testing.assert_allclose(trial.estimate.position_m[-1], moved, atol=0.005)
