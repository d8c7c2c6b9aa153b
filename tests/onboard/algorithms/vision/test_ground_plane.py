"""The motion over a plane from points alone."""

import math

import numpy as np
import pytest

from gloc3.camera.geometry import matrix
from gloc3.messages.frames import from_euler
from gloc3_onboard.algorithms.vision.ground_height import GroundHeight
from gloc3_onboard.algorithms.vision.ground_plane import PlaneNoise, Prior, appear, fit, on_plane, relief, start

NOISE = PlaneNoise(0.1 / 400.0, 1.5 / 400.0)
TURN_STD = np.array([0.003, 0.003, 0.02])
TRANSLATION = np.array([0.25, -0.1, 0.03])


def scene(
    raised: int = 0, slope: tuple[float, float] = (0.0, 0.0), seed: int = 1
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on a floor before and after a motion; the first `raised` stand 0.4 heights above it."""
    random = np.random.default_rng(seed)
    before = random.uniform((-0.6, -0.8), (0.6, 0.8), (100, 2))
    depth = np.where(np.arange(100) < raised, 0.6, 1.0)
    turn = matrix(from_euler(0.002, -0.002, 0.05))
    now = appear(on_plane(before, depth, np.array(slope)), TRANSLATION, turn)
    return before, now + random.normal(0.0, 0.1 / 400.0, now.shape), depth


def prior(slope_std: float = 0.015) -> Prior:
    return Prior(matrix(from_euler(0.0, 0.0, 0.045)), TURN_STD, np.zeros(2), slope_std)


def test_motion_and_turn_are_found_with_the_covariance_that_they_deserve() -> None:
    squares = []
    for seed in range(20):
        before, now, depth = scene(seed=seed)
        motion = fit(before, now, depth, prior(), np.array([0.2, 0.0, 0.0]), NOISE)
        error = motion.translation - TRANSLATION
        squares.append(error @ np.linalg.solve(motion.covariance[:3, :3], error) / 3.0)
        assert math.atan2(motion.turn[1, 0], motion.turn[0, 0]) == pytest.approx(0.05, abs=3e-4)
    assert 0.2 < np.mean(squares) < 2.0


def test_a_slope_is_found_and_not_taken_for_motion() -> None:
    before, now, depth = scene(slope=(0.05, -0.02))
    motion = fit(before, now, depth, prior(slope_std=0.05), np.zeros(3), NOISE)
    assert motion.slope == pytest.approx([0.05, -0.02], abs=0.004)
    assert motion.translation == pytest.approx(TRANSLATION, abs=0.002)


def test_points_on_a_box_are_left_out_and_their_height_is_told() -> None:
    before, now, _ = scene(raised=45)
    motion = fit(before, now, np.ones(100), prior(), np.array([0.24, -0.09, 0.0]), NOISE)
    assert motion.translation == pytest.approx(TRANSLATION, abs=0.002)
    assert not motion.is_inlier[:45].any()
    share, std, left = relief(before, now, motion)
    assert np.abs(share[:45] - 0.6).max() < 0.02
    assert std[:45].max() < 0.01
    assert left[:45].max() < 4.0 * motion.noise


def test_a_motion_that_nobody_expects_is_found_from_most_points() -> None:
    import cv2

    before, now, _ = scene(raised=20)
    begun = start(cv2, before, now, np.ones(100), prior(), 0.01)
    assert begun is not None
    assert begun == pytest.approx(TRANSLATION, abs=0.03)


def test_the_height_smooths_echoes_of_the_floor_and_of_a_known_box_and_turns_down_others() -> None:
    height = GroundHeight(noise_m=0.02, scale_std=0.0)
    height.begin(2.1)
    for _ in range(50):
        assert height.update(2.0, 1.0, (0.0,), 0.1)
    assert height.mean_m == pytest.approx(2.0, abs=0.01)
    before_m = height.mean_m
    assert not height.update(1.2, 1.0, (0.0,), 0.1)
    assert height.update(1.2, 1.0, (0.0, 0.8), 0.1)
    assert height.mean_m == pytest.approx(before_m, abs=0.001)
    assert not height.is_lost(5.0)
    height.rise(1.5, 0.001)
    assert height.mean_m == pytest.approx(3.0, abs=0.02)


def test_a_first_echo_that_none_confirms_is_soon_given_up() -> None:
    height = GroundHeight(noise_m=0.02, scale_std=0.0)
    height.begin(0.5)
    assert not height.update(2.0, 1.0, (0.0,), 0.1)
    assert height.is_lost(5.0)
