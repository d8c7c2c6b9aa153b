"""Conversion between pixels and directions: lens projection and its inverse. Needs numpy only."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.model import CameraModel, Lens
from gloc3.messages.frames import Quaternion

Array = NDArray[np.float64]

_ROUNDS: Final = 12
"""Newton steps at most; three are enough for a lens of 60 degrees."""
_CLOSE: Final = 1e-12
_STRAIGHT_AHEAD: Final = 1e-9


def matrix(a_from_b: Quaternion) -> Array:
    """The rotation as a matrix, (3, 3)."""
    w, x, y, z = a_from_b
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def project(camera: CameraModel, points_rdf_m: Array) -> Array:
    """Column and row of points, (n, 3) in the camera's axes; (n, 2), not-a-number for a point that is not in front."""
    depth = points_rdf_m[:, 2]
    safe = np.where(depth > _STRAIGHT_AHEAD, depth, np.nan)
    flat = points_rdf_m[:, :2] / safe[:, None]
    pixels: Array = bend(camera, flat) * np.array(camera.focal_px) + np.array(camera.center_px)
    return pixels


def unproject(camera: CameraModel, pixels: Array) -> Array:
    """Viewing rays of pixels: (n, 2) columns and rows to (n, 2) right and down at one metre along the optical axis.

    A pixel that the lens cannot show, beyond the point where its polynomial turns back, is NaN.
    """
    bent: Array = (np.asarray(pixels, float) - np.array(camera.center_px)) / np.array(camera.focal_px)
    if camera.lens is Lens.PINHOLE:
        return bent
    if camera.lens is Lens.EQUIDISTANT:
        return _straighten_fisheye(camera, bent)
    flat = bent.copy()
    for _ in range(_ROUNDS):
        error = bend(camera, flat) - bent
        a, b, c = _slopes(camera, flat)
        inverse = 1.0 / (a * c - b * b)
        step = np.column_stack((c * error[:, 0] - b * error[:, 1], a * error[:, 1] - b * error[:, 0]))
        flat -= step * inverse[:, None]
        if not np.nanmax(np.abs(error), initial=0.0) > _CLOSE:
            break
    wrong = ~(np.abs(bend(camera, flat) - bent).max(axis=1, initial=0.0) < 1e-6)
    flat[wrong] = np.nan
    return flat


def bend(camera: CameraModel, flat: Array) -> Array:
    """Applies the lens distortion to points at one metre, (n, 2) both: OpenCV's models, on the same scale."""
    if camera.lens is Lens.PINHOLE:
        return flat
    if camera.lens is Lens.EQUIDISTANT:
        radius = np.hypot(flat[:, 0], flat[:, 1])
        angle = np.arctan(radius)
        scale = np.where(radius > _STRAIGHT_AHEAD, _fisheye(camera, angle) / np.maximum(radius, _STRAIGHT_AHEAD), 1.0)
        bent: Array = flat * scale[:, None]
        return bent
    k1, k2, p1, p2, k3 = _radtan(camera)
    x, y = flat[:, 0], flat[:, 1]
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    return np.column_stack(
        (
            x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
            y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    )


def _slopes(camera: CameraModel, flat: Array) -> tuple[Array, Array, Array]:
    """The derivative of `bend` for radial and tangential lenses: d/dx of x, d/dy of x (and d/dx of y), d/dy of y."""
    k1, k2, p1, p2, k3 = _radtan(camera)
    x, y = flat[:, 0], flat[:, 1]
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    growth = 2.0 * (k1 + square * (2.0 * k2 + 3.0 * k3 * square))
    a = radial + growth * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    b = growth * x * y + 2.0 * p1 * x + 2.0 * p2 * y
    c = radial + growth * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    return a, b, c


def _straighten_fisheye(camera: CameraModel, bent: Array) -> Array:
    bent_radius = np.hypot(bent[:, 0], bent[:, 1])
    angle = bent_radius.copy()
    for _ in range(_ROUNDS):
        error = _fisheye(camera, angle) - bent_radius
        angle -= error / _fisheye_slope(camera, angle)
        if not np.nanmax(np.abs(error), initial=0.0) > _CLOSE:
            break
    is_wrong = ~(np.abs(_fisheye(camera, angle) - bent_radius) < 1e-6) | ~(angle < np.pi / 2.0) | ~(angle >= 0.0)
    scale = np.where(bent_radius > _STRAIGHT_AHEAD, np.tan(angle) / np.maximum(bent_radius, _STRAIGHT_AHEAD), 1.0)
    return bent * np.where(is_wrong, np.nan, scale)[:, None]


def _fisheye(camera: CameraModel, angle: Array) -> Array:
    k1, k2, k3, k4 = _padded(camera, 4)
    square = angle * angle
    return angle * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4))))


def _fisheye_slope(camera: CameraModel, angle: Array) -> Array:
    k1, k2, k3, k4 = _padded(camera, 4)
    square = angle * angle
    return 1.0 + square * (3.0 * k1 + square * (5.0 * k2 + square * (7.0 * k3 + square * 9.0 * k4)))


def _radtan(camera: CameraModel) -> tuple[float, ...]:
    return _padded(camera, 5)


def _padded(camera: CameraModel, count: int) -> tuple[float, ...]:
    return (*camera.distortion, *([0.0] * count))[:count]
