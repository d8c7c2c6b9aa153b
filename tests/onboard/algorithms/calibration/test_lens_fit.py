"""Lenses from corners with known noise: right within bounds and within what they claim; bad pictures and corners left out."""

import numpy as np
import pytest
from tests.onboard.algorithms.calibration.rendered import CAMERA, CHECKERBOARD, FISHEYE, GRID, BoardRenderer
from tests.onboard.algorithms.calibration.scenes import seen

from gloc3.camera.model import CameraModel, Lens
from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.boards import AprilGrid, Checkerboard, Floats
from gloc3_onboard.algorithms.calibration.lens_fit import board_pose, fit_lens

SIZE = (CAMERA.width, CAMERA.height)


def poses(count: int, seed: int = 0, tilt_deg: float = 35.0) -> list[Floats]:
    return BoardRenderer(CAMERA, CHECKERBOARD).poses(count, seed, tilt_deg)


def errors_in_sigmas(camera: CameraModel, board: Checkerboard | AprilGrid, seed: int) -> Floats:
    fit = fit_lens(seen(camera, board, poses(20, seed), 0.1, seed), SIZE, camera.lens)
    truth = np.array([*camera.focal_px, *camera.center_px, *camera.distortion])
    assert np.abs((fit.intrinsics - truth)[:4]).max() < 1.5
    assert fit.rms_px == pytest.approx(0.1 * np.sqrt(2.0), rel=0.15)
    return np.asarray((fit.intrinsics - truth) / fit.std)


@pytest.mark.parametrize("board", [CHECKERBOARD, GRID], ids=["checkerboard", "grid"])
@pytest.mark.parametrize("camera", [CAMERA, FISHEYE], ids=["radtan", "equidistant"])
def test_a_lens_is_right_within_what_it_claims(camera: CameraModel, board: Checkerboard | AprilGrid) -> None:
    sigmas = np.array([errors_in_sigmas(camera, board, seed) for seed in range(4)])
    assert np.abs(sigmas).max() < 4.0
    assert 0.4 < np.sqrt((sigmas**2).mean()) < 1.4


def test_a_picture_that_does_not_fit_is_left_out_with_its_error() -> None:
    views = seen(CAMERA, CHECKERBOARD, poses(12))
    bent = views[4].pixels * (1.0 + 1e-4 * (views[4].points_m[:, :1] / 0.02) ** 2)
    views[4] = views[4]._replace(pixels=bent + np.random.default_rng(1).normal(0.0, 1.5, bent.shape))
    fit = fit_lens(views, SIZE, Lens.RADTAN)
    ((name, error_px),) = fit.left_out
    assert (name, error_px > 1.0) == ("04.png", True)
    assert abs(fit.model.focal_px[0] - CAMERA.focal_px[0]) < 1.5


def test_a_corner_that_does_not_fit_is_left_out_and_its_picture_kept() -> None:
    views = seen(CAMERA, CHECKERBOARD, poses(10))
    wrong = views[3].pixels.copy()
    wrong[7] += 3.0
    views[3] = views[3]._replace(pixels=wrong)
    fit = fit_lens(views, SIZE, Lens.RADTAN)
    assert fit.left_out == ()
    assert [len(view.pixels) for view in fit.views].count(53) == 1
    assert fit.rms_px < 0.2


def test_too_few_pictures_are_refused() -> None:
    with pytest.raises(Refused, match="2 pictures with a board are not enough: it takes 3"):
        fit_lens(seen(CAMERA, CHECKERBOARD, poses(2)), SIZE, Lens.RADTAN)


@pytest.mark.parametrize("camera", [CAMERA, FISHEYE], ids=["radtan", "equidistant"])
def test_the_pose_of_a_board_is_found(camera: CameraModel) -> None:
    (pose,) = poses(1)
    (view,) = seen(camera, GRID, [pose], noise_px=0.0)
    assert board_pose(camera, view) == pytest.approx(pose, abs=1e-5)
