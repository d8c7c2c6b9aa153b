"""Corners as cameras see them, with noise and without pictures: views of a board from known poses."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from gloc3.camera.geometry import project
from gloc3.camera.model import CameraModel
from gloc3_onboard.algorithms.calibration.boards import AprilGrid, BoardView, Checkerboard, Floats


def points_of(board: Checkerboard | AprilGrid) -> Floats:
    """All corners of a board, (n, 3)."""
    if isinstance(board, Checkerboard):
        return board.points_m
    return np.concatenate([board.corners_m(board.first_id + tag) for tag in range(board.columns * board.rows)])


def seen(
    camera: CameraModel, board: Checkerboard | AprilGrid, poses: Sequence[Floats], noise_px: float = 0.1, seed: int = 0
) -> list[BoardView]:
    """The board's corners as far as they are in the picture, with normal noise."""
    random = np.random.default_rng(seed)
    views = []
    for number, pose in enumerate(poses):
        points = points_of(board)
        pixels = project(camera, Rotation.from_rotvec(pose[:3]).apply(points) + pose[3:])
        pixels = pixels + random.normal(0.0, noise_px, pixels.shape)
        with np.errstate(invalid="ignore"):
            inside = ((pixels > 0.0) & (pixels < (camera.width - 1.0, camera.height - 1.0))).all(axis=1)
        views.append(BoardView(points[inside], pixels[inside], f"{number:02}.png"))
    return views
