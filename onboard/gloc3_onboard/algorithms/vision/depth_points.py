"""Points of a depth picture on the body, without the points between near and far things that a depth camera makes up."""

from math import ceil, sqrt
from typing import Final

import numpy as np

from gloc3.camera.geometry import Array, matrix, unproject
from gloc3.camera.model import CameraModel
from gloc3.messages.perception import DepthImage

SAME_SHARE: Final = 0.05
"""Neighbouring pixels whose depths differ by less than this share show the same thing."""


class DepthPoints:
    """Finds the points of the pictures of one depth camera.

    Args:
        model: the camera.
        most_points: of a picture, at most; pixels in between are left out.
    """

    def __init__(self, model: CameraModel, most_points: int) -> None:
        self.model: Final = model
        self.step: Final = ceil(sqrt(model.width * model.height / most_points))
        """Every so many pixels along a row and a column are used."""
        columns, rows = np.meshgrid(np.arange(0, model.width, self.step), np.arange(0, model.height, self.step))
        flat = unproject(model, np.column_stack((columns.ravel(), rows.ravel())))
        rays = np.column_stack((flat, np.ones(len(flat)))) @ matrix(model.frd_from_rdf).T
        self._rays = rays.reshape(*columns.shape, 3)

    def points_frd_m(self, depth: DepthImage) -> Array:
        """What a picture of the camera's size shows, shape (n, 3), in the body's axes."""
        raw = np.frombuffer(depth.data, "<u2").reshape(depth.height, depth.width)
        away_m = raw * depth.scale_m
        is_measured = (raw > 0) & (away_m >= depth.range_min_m) & (away_m <= depth.range_max_m)
        away_m[~is_measured] = np.nan
        is_one = is_measured & _has_like(away_m) & _has_like(away_m.T).T
        used, rays = slice(None, None, self.step), self._rays
        is_used = is_one[used, used] & np.isfinite(rays[..., 0])
        points: Array = rays[is_used] * away_m[used, used][is_used][:, None] + self.model.position_frd_m
        return points


def _has_like(away_m: Array) -> "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]":
    """Whether the pixel before or behind in its row is about as far away."""
    near = np.abs(np.diff(away_m, axis=1)) < SAME_SHARE * away_m[:, 1:]
    found = np.zeros(away_m.shape, np.bool_)
    found[:, 1:] |= near
    found[:, :-1] |= near
    return found
