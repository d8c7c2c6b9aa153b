"""Lenses: where a point appears in a camera's picture, and which way a pixel looks.

The formulae stand here by themselves, apart from OpenCV's, which the onboard side uses: an error in one does not
hide one in the other.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.camera_model import CameraModel, Lens

Floats = NDArray[np.float64]

_NEWTON_STEPS: Final = 12


def project(model: CameraModel, points_rdf_m: Floats) -> Floats:
    """Columns and rows, shape `(n, 2)`, at which points appear; also beyond the picture.

    Args:
        model: the camera.
        points_rdf_m: shape `(n, 3)`, in front of the camera (an equidistant lens also sees what is beside it).
    """
    right, down, forward = np.asarray(points_rdf_m, float).T
    if model.lens is Lens.EQUIDISTANT:
        across = np.hypot(right, down)
        angle = np.arctan2(across, forward)
        scale = np.where(across > 1e-12, _bent(model, angle) / np.maximum(across, 1e-12), 1.0)
        flat = np.column_stack([right * scale, down * scale])
    else:
        flat = np.column_stack([right / forward, down / forward])
        if model.lens is Lens.RADTAN:
            flat = _distorted(model, flat)
    return flat * model.focal_px + model.center_px


def rays(model: CameraModel, pixels: Floats) -> Floats:
    """Unit vectors, shape `(n, 3)`, right, down and forward, along which pixels look."""
    flat = (np.asarray(pixels, float) - model.center_px) / model.focal_px
    if model.lens is Lens.EQUIDISTANT:
        across = np.hypot(*flat.T)
        angle = _unbent(model, across)
        scale = np.where(across > 1e-12, np.sin(angle) / np.maximum(across, 1e-12), 1.0)
        return np.column_stack([flat * scale[:, None], np.cos(angle)])
    if model.lens is Lens.RADTAN:
        flat = _undistorted(model, flat)
    found = np.column_stack([flat, np.ones(len(flat))])
    unit: Floats = found / np.linalg.norm(found, axis=1, keepdims=True)
    return unit


def _distorted(model: CameraModel, flat: Floats) -> Floats:
    """Brown's model (1966) with the signs of OpenCV: k1, k2, p1, p2, k3."""
    k1, k2, p1, p2, k3 = _coefficients(model, 5)
    x, y = flat.T
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    return np.column_stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
            y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    )


def _undistorted(model: CameraModel, flat: Floats) -> Floats:
    """The inverse, by Newton's method on the radial part; the tangential part is small, so that this converges too."""
    k1, k2, _, _, k3 = _coefficients(model, 5)
    found = flat.copy()
    for _ in range(_NEWTON_STEPS):
        error = _distorted(model, found) - flat
        if np.abs(error).max(initial=0.0) < 1e-12:
            break
        square = (found * found).sum(axis=1)
        radial = 1.0 + square * (k1 + square * (k2 + square * k3))
        growth = 2.0 * (k1 + square * (2.0 * k2 + square * 3.0 * k3))
        along = (found * error).sum(axis=1) * growth / (radial + growth * square)
        found -= (error - found * along[:, None]) / radial[:, None]
    return found


def _bent(model: CameraModel, angle: Floats) -> Floats:
    """Distance from the middle, in focal lengths, of a ray at an angle from the axis (Kannala and Brandt 2006)."""
    k1, k2, k3, k4 = _coefficients(model, 4)
    square = angle * angle
    bent: Floats = angle * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
    return bent


def _unbent(model: CameraModel, across: Floats) -> Floats:
    """The inverse, by Newton's method."""
    k1, k2, k3, k4 = _coefficients(model, 4)
    angle = across.copy()
    for _ in range(_NEWTON_STEPS):
        square = angle * angle
        slope = 1.0 + square * (3.0 * k1 + square * (5.0 * k2 + square * (7.0 * k3 + square * 9.0 * k4)))
        angle -= (_bent(model, angle) - across) / slope
    return angle


def _coefficients(model: CameraModel, count: int) -> tuple[float, ...]:
    """The coefficients of a lens, those that are not given as 0."""
    return (*model.distortion[:count], *(0.0,) * (count - len(model.distortion)))
