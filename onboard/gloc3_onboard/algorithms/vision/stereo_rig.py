"""Geometry of a stereo pair: rays in rectified axes, where a match has the same row.

The rectified frame has its origin in the left camera, x to the right camera, z ahead, as near to both optical axes as x
allows. Pictures are never warped; only points are.
"""

from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.geometry import Array, bend, matrix, unproject
from gloc3.camera.model import CameraModel, Lens
from gloc3.errors import Refused

_BASELINE_MIN_M: Final = 1e-3
_ASKEW_MAX: Final = 0.8
"""Largest cosine between the baseline and the cameras' viewing directions."""
_TABLE_PX: Final = 2
_COEFFICIENTS: Final = {Lens.PINHOLE: (0,), Lens.RADTAN: (4, 5), Lens.EQUIDISTANT: (4,)}
"""How many a lens of each kind has."""


class StereoRig:
    """A calibrated stereo pair.

    Raises:
        Refused: the cameras are no pair: no baseline, one behind the other, or diverging.
    """

    def __init__(self, left: CameraModel, right: CameraModel) -> None:
        _require_numbers(left)
        _require_numbers(right)
        self.left: Final = left
        self.right: Final = right
        frd_from_left, frd_from_right = matrix(left.frd_from_rdf), matrix(right.frd_from_rdf)
        base = np.array(right.position_frd_m) - np.array(left.position_frd_m)
        self.baseline_m: Final = float(np.linalg.norm(base))
        """Distance of the optical centres."""
        if not self.baseline_m >= _BASELINE_MIN_M:
            raise Refused("the cameras of a stereo pair must be apart: their positions on the body are the same")
        across = base / self.baseline_m
        ahead = frd_from_left[:, 2] + frd_from_right[:, 2]
        if float(frd_from_left[:, 2] @ frd_from_right[:, 2]) < 0.5:
            raise Refused("the cameras of a stereo pair look apart")
        if abs(float(across @ ahead)) > _ASKEW_MAX * float(np.linalg.norm(ahead)):
            raise Refused("one camera of the stereo pair is behind the other")
        if float(across @ frd_from_left[:, 0]) < 0.0:
            raise Refused("the left camera of the stereo pair is on the right: exchange them")
        # Rectified axes: x along the baseline, y = cross(ahead, x), z = cross(x, y).
        down = np.cross(ahead, across)
        down /= np.linalg.norm(down)
        self.frd_from_rectified: Final[Array] = np.column_stack([across, down, np.cross(across, down)])
        """Rotation of the rectified frame to the body."""
        self.position_frd_m: Final[Array] = np.array(left.position_frd_m, np.float64)
        """Origin of the rectified frame on the body."""
        self.focal_px: Final = float(np.mean((*left.focal_px, *right.focal_px)))
        """Pixels that a ray moves by for each unit, near the middle of a picture."""
        self._rectified = (self.frd_from_rectified.T @ frd_from_left, self.frd_from_rectified.T @ frd_from_right)
        self._rays = (_RayTable(left, self._rectified[0]), _RayTable(right, self._rectified[1]))

    def left_rays(self, pixels: NDArray[Any]) -> Array:
        """Rectified rays (n, 2) of pixels inside the left picture."""
        return self._rays[0].of(pixels)

    def right_rays(self, pixels: NDArray[Any]) -> Array:
        """Rectified rays (n, 2) of pixels inside the right picture, not-a-number for those of none."""
        return self._rays[1].of(pixels)

    def left_pixels(self, rays: Array) -> Array:
        """Where rectified rays appear in the left picture."""
        return _pixels(self.left, _turned(rays, self._rectified[0].T))

    def right_pixels(self, rays: Array) -> Array:
        """Where rectified rays appear in the right picture."""
        return _pixels(self.right, _turned(rays, self._rectified[1].T))


@lru_cache(maxsize=4)
def stereo_rig(left: CameraModel, right: CameraModel) -> StereoRig:
    """The rig of a pair, cached; raises as `StereoRig` does."""
    return StereoRig(left, right)


class _RayTable:
    """The rectified rays of every second pixel of every second row; those between are interpolated, to 0.001 pixels."""

    def __init__(self, camera: CameraModel, rotation: Array) -> None:
        columns, rows = camera.width // _TABLE_PX + 2, camera.height // _TABLE_PX + 2
        grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2) * _TABLE_PX
        self._rays: Array = _turned(unproject(camera, grid.astype(np.float64)), rotation)
        self._columns = columns
        self._most = np.array([columns - 2, rows - 2])

    def of(self, pixels: NDArray[Any]) -> Array:
        at = pixels.astype(np.float64) / _TABLE_PX
        whole = np.clip(np.nan_to_num(at), 0, self._most).astype(np.intp)
        right, down = (at - whole).T[:, :, None]
        first = whole[:, 1] * self._columns + whole[:, 0]
        rays, below = self._rays, first + self._columns
        upper = rays[first] * (1.0 - right) + rays[first + 1] * right
        lower = rays[below] * (1.0 - right) + rays[below + 1] * right
        found: Array = upper * (1.0 - down) + lower * down
        return found


def _require_numbers(camera: CameraModel) -> None:
    if len(camera.distortion) not in _COEFFICIENTS[camera.lens]:
        wanted = " or ".join(map(str, _COEFFICIENTS[camera.lens]))
        raise Refused(f"a {camera.lens} lens has {wanted} coefficients of distortion, not {len(camera.distortion)}")
    numbers = (*camera.distortion, *camera.focal_px, *camera.center_px, *camera.position_frd_m, *camera.frd_from_rdf)
    if not np.isfinite(numbers).all():
        raise Refused("a number of a camera's calibration is not finite")


def _pixels(camera: CameraModel, rays: Array) -> Array:
    pixels: Array = bend(camera, rays) * np.array(camera.focal_px) + np.array(camera.center_px)
    return pixels


def _turned(rays: Array, rotation: Array) -> Array:
    """The rays in other axes; not-a-number for those that then lie behind."""
    turned = rays @ rotation[:, :2].T + rotation[:, 2]
    depth = np.where(turned[:, 2:] > 1e-3, turned[:, 2:], np.nan)
    ahead: Array = turned[:, :2] / depth
    return ahead
