"""The rig and the fit of a pose, without pictures."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from tests.onboard.algorithms.vision.wall import cameras

from gloc3.camera.model import Lens
from gloc3.errors import Refused
from gloc3.messages.frames import from_euler, multiply
from gloc3_onboard.algorithms.vision.pose_fit import Points, PoseFitNoise, fit_pose, rotation_of
from gloc3_onboard.algorithms.vision.stereo_rig import StereoRig

NOISE = PoseFitNoise(ray=5e-4, disparity=5e-4)
BASE_M = 0.15


def rig(**changes: object) -> StereoRig:
    left, right = cameras()
    return StereoRig(left, msgspec.structs.replace(right, **changes))


def test_a_point_is_on_one_row_of_the_rectified_pair_whatever_the_lenses_and_turns() -> None:
    left, right = cameras()
    ahead = left.frd_from_rdf
    left = msgspec.structs.replace(left, frd_from_rdf=multiply(from_euler(0.02, -0.01, 0.03), ahead))
    right = msgspec.structs.replace(
        right,
        frd_from_rdf=multiply(from_euler(-0.03, 0.02, -0.02), ahead),
        position_frd_m=(0.01, 0.07, 0.005),
        lens=Lens.RADTAN,
        distortion=(-0.2, 0.05, 1e-3, -5e-4),
    )
    pair = StereoRig(left, right)
    rays = np.random.default_rng(1).uniform(-0.4, 0.4, (50, 2))
    disparity = np.random.default_rng(2).uniform(0.01, 0.15, 50)
    other = rays - np.column_stack([disparity, np.zeros(50)])
    np.testing.assert_allclose(pair.left_rays(pair.left_pixels(rays)), rays, atol=1e-5)
    np.testing.assert_allclose(pair.right_rays(pair.right_pixels(other)), other, atol=1e-5)
    # The same place in space by both cameras: left ray at a depth is the right one's, moved by the baseline.
    depth = pair.baseline_m / disparity
    places = np.column_stack([rays, np.ones(50)]) * depth[:, None]
    from_right = np.column_stack([other, np.ones(50)]) * depth[:, None]
    np.testing.assert_allclose(places - from_right, np.tile([pair.baseline_m, 0, 0], (50, 1)), atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"position_frd_m": (0.0, -0.075, 0.0)}, "must be apart"),
        ({"position_frd_m": (0.0, -0.3, 0.0)}, "exchange them"),
        ({"position_frd_m": (0.5, 0.0, 0.0)}, "behind the other"),
        ({"frd_from_rdf": (1.0, 0.0, 0.0, 0.0)}, "look apart"),
        ({"lens": Lens.RADTAN}, "4 or 5 coefficients"),
        ({"focal_px": (float("nan"), 200.0)}, "not finite"),
    ],
)
def test_cameras_that_are_no_pair_are_refused_with_a_reason(changes: dict[str, object], said: str) -> None:
    with pytest.raises(Refused, match=said):
        rig(**changes)


def scene(seed: int, count: int = 120, outliers: int = 0, noise: float = 5e-4) -> tuple[Points, np.ndarray, np.ndarray]:
    """Points seen twice, and the pose between."""
    random = np.random.default_rng(seed)
    rays = random.uniform(-0.7, 0.7, (count, 2))
    inverse = random.uniform(0.15, 0.6, count)
    p, r = random.normal(0.0, 0.15, 3), rotation_of(random.normal(0.0, 0.05, 3))
    seen = (np.column_stack([rays, np.ones(count)]) - inverse[:, None] * p) @ r
    measured = np.column_stack([seen[:, 0], seen[:, 1], BASE_M * inverse]) / seen[:, 2:]
    measured += random.normal(0.0, noise, measured.shape)
    measured[:outliers] += random.uniform(-0.3, 0.3, (outliers, 3))
    prior = np.maximum(inverse + random.normal(0.0, noise / BASE_M, count), 1e-3)
    points = Points(rays=rays, inverse_m=prior, inverse_variance=np.full(count, (noise / BASE_M) ** 2), seen=measured)
    return points, p, r


def test_the_fit_finds_the_motion_among_outliers_and_says_how_well() -> None:
    squares = []
    for seed in range(20):
        points, p, r = scene(seed, outliers=40)
        fit = fit_pose(points, BASE_M, NOISE, np.zeros(3), np.eye(3))
        assert fit is not None
        assert fit.has_converged
        assert not fit.is_inlier[:40].any() or fit.is_inlier[:40].sum() <= 2
        assert fit.is_inlier[40:].mean() > 0.9
        turn = r.T @ fit.rotation
        error = np.concatenate(
            [
                fit.position_m - p,
                [(turn[2, 1] - turn[1, 2]) / 2, (turn[0, 2] - turn[2, 0]) / 2, (turn[1, 0] - turn[0, 1]) / 2],
            ]
        )
        squares.append(error @ np.linalg.solve(fit.covariance, error))
    assert 3.5 < np.mean(squares) < 9.0  # 6 degrees of freedom; outliers take some of the certainty


def test_points_without_a_disparity_now_still_tell_the_motion() -> None:
    points, p, _ = scene(3)
    points.seen[:, 2] = np.nan
    fit = fit_pose(points, BASE_M, NOISE, np.zeros(3), np.eye(3))
    assert fit is not None
    assert np.linalg.norm(fit.position_m - p) < 5e-3


def test_points_that_tell_nothing_have_no_motion() -> None:
    points, _, _ = scene(3, count=1)
    fit = fit_pose(points, BASE_M, NOISE, np.zeros(3), np.eye(3))
    assert fit is None or np.sqrt(np.trace(fit.covariance[:3, :3])) > 1.0


def test_a_constant_in_all_disparities_is_found_by_a_drive_ahead() -> None:
    random, offset = np.random.default_rng(3), 4e-3
    rays, inverse_m = random.uniform(-0.5, 0.5, (150, 2)), random.uniform(0.03, 0.5, 150)
    moved = np.column_stack([rays, np.ones(150)]) - inverse_m[:, None] * np.array([0.0, 0.0, 0.8])
    seen = np.column_stack([moved[:, :2] / moved[:, 2:], BASE_M * inverse_m / moved[:, 2] + offset])
    points = Points(
        rays=rays,
        inverse_m=inverse_m + offset / BASE_M,
        inverse_variance=np.full(150, (NOISE.disparity / BASE_M) ** 2),
        seen=seen + random.normal(0.0, 1e-4, seen.shape),
    )
    exact = fit_pose(points, BASE_M, NOISE, np.zeros(3), np.eye(3))
    learning = fit_pose(points, BASE_M, replace(NOISE, offset=5e-3), np.zeros(3), np.eye(3))
    assert exact is not None
    assert learning is not None
    assert exact.position_m[2] < 0.77
    assert learning.position_m[2] == pytest.approx(0.8, abs=0.02)
    assert learning.offset == pytest.approx(offset, rel=0.1)
