"""Pixels and directions, against OpenCV."""

import cv2
import numpy as np
import pytest

from gloc3.camera.geometry import matrix, project, unproject
from gloc3.camera.model import CameraModel, Lens
from gloc3.messages.frames import from_euler, rotate

CAMERAS = {
    "pinhole": CameraModel(width=640, height=480, focal_px=(400.0, 402.0), center_px=(319.5, 239.5)),
    "radtan": CameraModel(
        width=752,
        height=480,
        focal_px=(458.7, 457.3),
        center_px=(367.2, 248.4),
        lens=Lens.RADTAN,
        distortion=(-0.283, 0.074, 0.0002, 0.00002),
    ),
    "equidistant": CameraModel(
        width=640,
        height=480,
        focal_px=(300.0, 300.0),
        center_px=(320.0, 240.0),
        lens=Lens.EQUIDISTANT,
        distortion=(-0.01, 0.03, -0.02, 0.005),
    ),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_every_pixel_of_a_picture_looks_where_opencv_says_and_back(name: str) -> None:
    camera = CAMERAS[name]
    columns, rows = np.meshgrid(np.linspace(0, camera.width - 1, 9), np.linspace(0, camera.height - 1, 7))
    pixels = np.column_stack((columns.ravel(), rows.ravel()))
    flat = unproject(camera, pixels)
    points = 2.5 * np.column_stack((flat, np.ones(len(flat))))
    assert np.abs(project(camera, points) - pixels).max() < 1e-6
    intrinsics = np.array(
        [[camera.focal_px[0], 0.0, camera.center_px[0]], [0.0, camera.focal_px[1], camera.center_px[1]], [0, 0, 1]]
    )
    coefficients = np.array([*camera.distortion, 0.0, 0.0, 0.0, 0.0][:4])
    if camera.lens is Lens.EQUIDISTANT:
        theirs, _ = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), intrinsics, coefficients)
    else:
        theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), intrinsics, coefficients)
    assert np.abs(theirs.reshape(-1, 2) - pixels).max() < 1e-6


def test_what_is_behind_a_camera_or_beyond_its_lens_is_not_a_number() -> None:
    assert np.isnan(project(CAMERAS["pinhole"], np.array([[0.1, 0.1, -1.0], [0.0, 0.0, 0.0]]))).all()
    assert np.isnan(unproject(CAMERAS["equidistant"], np.array([[2000.0, 240.0]]))).all()


def test_the_matrix_turns_as_the_quaternion_does() -> None:
    turn = from_euler(0.1, -0.4, 2.0)
    assert matrix(turn) @ np.array([1.0, -2.0, 3.0]) == pytest.approx(rotate(turn, (1.0, -2.0, 3.0)))
