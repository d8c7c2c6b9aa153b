"""Boards in rendered pictures: their corners are where they are, each with its place on the board."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.onboard.algorithms.calibration.rendered import CAMERA, CHECKERBOARD, GRID, BoardRenderer, Floats

from gloc3.camera.geometry import project
from gloc3_onboard.algorithms.calibration.boards import AprilGrid, BoardView, Checkerboard
from gloc3_onboard.algorithms.calibration.lens_fit import board_pose

GRID_RENDERER = BoardRenderer(CAMERA, GRID)
CHECKERBOARD_RENDERER = BoardRenderer(CAMERA, CHECKERBOARD)


def distances_px(view: BoardView, pose: Floats) -> Floats:
    places = Rotation.from_rotvec(pose[:3]).apply(view.points_m) + pose[3:]
    return np.asarray(np.linalg.norm(project(CAMERA, places) - view.pixels, axis=1))


def test_a_grid_of_tags_is_found_with_each_corner_at_its_place() -> None:
    for seed, pose in enumerate(GRID_RENDERER.poses(3, seed=3)):
        view = GRID.view(GRID_RENDERER.picture(pose, seed), "grid")
        assert view is not None
        assert len(view.pixels) >= 4 * 30
        away_px = distances_px(view, pose)
        assert np.median(away_px) < 0.15
        assert (away_px < 0.5).mean() > 0.95


def test_a_checkerboard_is_found_to_a_twentieth_of_a_pixel() -> None:
    (pose,) = CHECKERBOARD_RENDERER.poses(1, seed=3)
    view = CHECKERBOARD.view(CHECKERBOARD_RENDERER.picture(pose), "board")
    assert view is not None
    found = board_pose(CAMERA, view)
    assert np.linalg.norm(found[3:]) == pytest.approx(np.linalg.norm(pose[3:]), abs=0.15)
    assert np.sqrt((distances_px(view, found) ** 2).mean()) < 0.07


def test_a_grid_with_other_numbers_is_another_board() -> None:
    picture = GRID_RENDERER.picture(GRID_RENDERER.poses(1, seed=3)[0])
    assert AprilGrid(6, 6, 0.03, 0.3, first_id=100).view(picture, "grid") is None


@pytest.mark.parametrize("board", [CHECKERBOARD, GRID, Checkerboard(7, 5, (0.03, 0.03))])
def test_a_picture_without_the_board_has_none(board: Checkerboard | AprilGrid) -> None:
    grey = np.random.default_rng(0).normal(120.0, 20.0, (360, 480)).clip(0, 255).astype(np.uint8)
    assert board.view(grey, "none") is None
