"""A stereo pair in front of a flat wall, drawn in a fraction of a millisecond: for tests of what needs no world."""

from functools import cache

import cv2
import numpy as np

from gloc3.camera.model import CameraModel
from gloc3_onboard.algorithms.vision.picture import Picture

DISTANCE_M = 2.0
FOCAL_PX = 200.0
BASELINE_M = 0.15
WIDTH, HEIGHT = 320, 240


def cameras() -> tuple[CameraModel, CameraModel]:
    """Side by side at the middle of the body, looking ahead."""
    left, right = (
        CameraModel(
            width=WIDTH,
            height=HEIGHT,
            focal_px=(FOCAL_PX, FOCAL_PX),
            center_px=((WIDTH - 1) / 2.0, (HEIGHT - 1) / 2.0),
            position_frd_m=(0.0, side * BASELINE_M / 2.0, 0.0),
        )
        for side in (-1.0, 1.0)
    )
    return left, right


@cache
def _paint() -> Picture:
    random = np.random.default_rng(5)
    paint = sum(
        (cv2.GaussianBlur(random.normal(0.0, 1.0, (900, 1400)), (0, 0), size) * size for size in (1.5, 4.0, 12.0)),
        np.zeros((900, 1400)),
    )
    painted: Picture = np.clip(120.0 + 90.0 * paint / np.abs(paint).max(), 0, 255).astype(np.uint8)
    return painted


def poll(right_m: float, down_m: float = 0.0, seed: int = 0, noise_grey: float = 1.0) -> tuple[Picture, Picture]:
    """The pair, from so far to the right of and below the begin."""
    random = np.random.default_rng([seed, 3])
    pictures = []
    for side in (-1.0, 1.0):
        column = 700.0 + (right_m + side * BASELINE_M / 2.0) * FOCAL_PX / DISTANCE_M
        row = 450.0 + down_m * FOCAL_PX / DISTANCE_M
        cut = cv2.getRectSubPix(_paint(), (WIDTH, HEIGHT), (column, row), patchType=cv2.CV_32F)
        noisy = cut + random.normal(0.0, noise_grey, cut.shape)
        pictures.append(np.clip(np.round(noisy), 0, 255).astype(np.uint8))
    return pictures[0], pictures[1]
