"""Folders of rendered pictures of a pair of cameras with a known place."""

from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Final

import numpy as np
from msgspec.structs import replace
from tests.onboard.algorithms.calibration.rendered import CAMERA, CHECKERBOARD, BoardRenderer, Floats
from tests.onboard.algorithms.calibration.scenes import seen

from gloc3.camera.model import CameraModel
from gloc3.camera.opencv import load_opencv
from gloc3_onboard.algorithms.calibration.bundle import then

RIGHT: Final = replace(CAMERA, focal_px=(405.0, 403.2), center_px=(236.0, 181.0))
RIGHT_FROM_LEFT: Final = np.array([0.01, -0.03, 0.005, -0.07, 0.002, 0.004])
BOARD: Final = "checkerboard:9x6:0.025"
COUNT: Final = 10


@cache
def pair_folder() -> Path:
    """left01.png, right01.png and so on."""
    folder = Path(mkdtemp())
    cv2 = load_opencv()
    left, right = BoardRenderer(CAMERA, CHECKERBOARD), BoardRenderer(RIGHT, CHECKERBOARD)
    whole = [
        pose
        for pose in left.poses(40, seed=3)
        if _is_whole(CAMERA, pose) and _is_whole(RIGHT, then(RIGHT_FROM_LEFT, pose))
    ]
    for number, pose in enumerate(whole[:COUNT], start=1):
        cv2.imwrite(str(folder / f"left{number:02}.png"), left.picture(pose, number))
        cv2.imwrite(str(folder / f"right{number:02}.png"), right.picture(then(RIGHT_FROM_LEFT, pose), 100 + number))
    return folder


def _is_whole(camera: CameraModel, pose: Floats) -> bool:
    wide = replace(camera, width=camera.width - 24, height=camera.height - 24)
    moved = replace(wide, center_px=(camera.center_px[0] - 12.0, camera.center_px[1] - 12.0))
    (view,) = seen(moved, CHECKERBOARD, [pose])
    return len(view.pixels) == len(CHECKERBOARD.points_m)


def grey_picture(path: Path, width: int = 480, height: int = 360) -> None:
    """A picture without a board."""
    load_opencv().imwrite(str(path), np.full((height, width), 120, np.uint8))
