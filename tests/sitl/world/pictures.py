"""Helpers of picture tests: shifts between pictures to a hundredth of a pixel, and what a wall must look like."""

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from gloc3.camera.model import CameraModel, Lens
from gloc3.messages.frames import rotate
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.imager import Imager
from gloc3_sitl.world.texture import Image, paint

Floats = NDArray[np.float64]
CLEAN = Imager(name="clean", noise_grey=0.0)


def shift_px(first: NDArray[np.generic], second: NDArray[np.generic]) -> tuple[float, float]:
    """By how many columns and rows the second picture is moved against the first; less than about two pixels."""
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-6)
    start = np.eye(2, 3, dtype=np.float32)
    _, moved = cv2.findTransformECC(
        first.astype(np.float32), second.astype(np.float32), start, cv2.MOTION_TRANSLATION, stop
    )
    return float(moved[0, 2]), float(moved[1, 2])


def largest_shift_px(first: Image, second: Image, block: int = 96) -> float:
    """The largest shift among the blocks of two pictures that ought to be equal."""
    rows, columns = first.shape
    shifts = [
        shift_px(first[top : top + block, left : left + block], second[top : top + block, left : left + block])
        for top in range(0, rows - block + 1, block)
        for left in range(0, columns - block + 1, block)
    ]
    return max(float(np.hypot(*shift)) for shift in shifts)


def with_hold(**changes: object) -> World:
    """The hold with its file changed."""
    return World(msgspec.structs.replace(World.load("hold").file, **changes))


def looks(model: CameraModel) -> Floats:
    """Directions (right, down, forward) of all pixels by OpenCV's own inverse of the lens, shape `(rows * columns, 3)`."""
    columns, rows = np.meshgrid(np.arange(model.width, dtype=float), np.arange(model.height, dtype=float))
    pixels = np.column_stack([columns.ravel(), rows.ravel()])[:, None]
    (fx, fy), (cx, cy) = model.focal_px, model.center_px
    intrinsics = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    distortion = np.zeros(4)
    distortion[: len(model.distortion)] = model.distortion[:4]
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-10)
    if model.lens is Lens.EQUIDISTANT:
        flat = cv2.fisheye.undistortPoints(pixels, intrinsics, distortion, criteria=criteria)
    else:
        flat = cv2.undistortPoints(pixels, intrinsics, distortion, criteria=criteria)
    return np.column_stack([flat.reshape(-1, 2), np.ones(len(pixels))])


def fore_wall_by_hand(camera: SimulatedCamera, truth: Truth) -> Image:
    """The hold's fore bulkhead as each pixel's own ray meets it, without homographies: what the picture must be."""
    world, model = camera.world, camera.model
    local_from_rdf, eye = camera.pose(truth)
    axes = [rotate(local_from_rdf, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
    directions = looks(model) @ np.array(axes)
    surface = world.file.surfaces["fore"]
    texture = world.file.textures[surface.texture]
    reach = (surface.corner_m[0] - eye[0]) / directions[:, 0]
    across_m = surface.corner_m[1] - (eye[1] + reach * directions[:, 1])
    down_m = surface.corner_m[2] - (eye[2] + reach * directions[:, 2])
    picture = cv2.copyMakeBorder(paint(texture), 8, 8, 8, 8, cv2.BORDER_WRAP)
    rows, columns = paint(texture).shape
    scale = texture.resolution_px_m
    x = (across_m * scale - 0.5) % columns + 8.0
    y = (down_m * scale - 0.5) % rows + 8.0
    shape = (model.height, model.width)
    found = cv2.remap(
        picture, x.reshape(shape).astype(np.float32), y.reshape(shape).astype(np.float32), cv2.INTER_LINEAR
    )
    return np.asarray(cv2.convertScaleAbs(found, alpha=world.file.lighting.ambient), np.uint8)
