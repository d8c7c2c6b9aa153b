"""Grains of dust that float in the air and catch the light: bright spots that do not move with what is behind them."""

from typing import Any, Final

import numpy as np

from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.model import Dust
from gloc3_sitl.world.patches import Pinhole, View
from gloc3_sitl.world.texture import Image

_CUBE_M: Final = 4.0
"""The same cube of grains fills all of the world."""
_DRIFT_M_S: Final = (0.06, -0.04, -0.03)
_NEAR_M: Final = 0.15
_FAR_M: Final = 1.9
_RADIUS_M: Final = 0.002


class Grains:
    """Grains at seeded places, that drift."""

    def __init__(self, dust: Dust, seed: int) -> None:
        random = np.random.Generator(np.random.PCG64([seed, 0xD057]))
        self._places = random.uniform(0.0, _CUBE_M, (round(dust.grains_per_m3 * _CUBE_M**3), 3))
        self._drift = np.array(_DRIFT_M_S)
        self._grey = dust.grain_grey

    def __bool__(self) -> bool:
        return len(self._places) > 0

    def draw(self, cv2: Any, image: Image, pinhole: Pinhole, view: View) -> None:
        """Brightens a picture where grains are."""
        for column, row, depth_m in self._seen(pinhole, view):
            radius_px = max(0.7, _RADIUS_M * pinhole.focal_px[0] / depth_m)
            half = int(2.5 * radius_px) + 1
            left, top = int(column) - half, int(row) - half
            cut = image[max(0, top) : top + 2 * half + 1, max(0, left) : left + 2 * half + 1]
            if not cut.size:
                continue
            rows = np.arange(max(0, top), max(0, top) + cut.shape[0]) - row
            columns = np.arange(max(0, left), max(0, left) + cut.shape[1]) - column
            square = rows[:, None] ** 2 + columns**2
            spot = self._grey * min(1.0, 0.25 / depth_m**2) * np.exp(-square / (2.0 * radius_px**2))
            cv2.add(cut, spot.astype(np.uint8), dst=cut)

    def _seen(self, pinhole: Pinhole, view: View) -> list[tuple[float, float, float]]:
        """Column, row and depth of those in view."""
        eye = np.array(view.eye_m)
        away = (self._places + self._drift * view.t_s - eye + _CUBE_M / 2.0) % _CUBE_M - _CUBE_M / 2.0
        right, down, forward = (away @ view.rdf_from_local.T).T
        near = (forward > _NEAR_M) & (np.linalg.norm(away, axis=1) < _FAR_M)
        right, down, forward = right[near], down[near], forward[near]
        (focal_x, focal_y), (center_x, center_y) = pinhole.focal_px, pinhole.center_px
        columns, rows = center_x + focal_x * right / forward, center_y + focal_y * down / forward
        inside = (columns > -20) & (columns < pinhole.width + 20) & (rows > -20) & (rows < pinhole.height + 20)
        found: Floats = np.column_stack([columns, rows, forward])[inside]
        return [(float(column), float(row), float(depth)) for column, row, depth in found]
