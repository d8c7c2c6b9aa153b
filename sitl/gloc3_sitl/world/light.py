"""How bright a picture is: lamps, haze and the gain of the camera, on a coarse grid over each patch."""

from math import cos, radians
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.frames import Vector3, rotate
from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.model import Dust, Lamp, Lighting
from gloc3_sitl.world.patches import Patch
from gloc3_sitl.world.placing import Place
from gloc3_sitl.world.sheets import Sheets
from gloc3_sitl.world.texture import Image

_CELL_PX: Final = 16
_NEAR_M: Final = 0.3
_LEAST_GAIN: Final = 0.25
_MOST_GAIN: Final = 12.0


class Glow(NamedTuple):
    """The light over one patch, on a coarse grid."""

    factor: NDArray[np.float32]
    """What the grey values of the texture are multiplied with."""
    veil: NDArray[np.float32] | None
    """What haze adds, in grey values at a gain of 1."""


class Light:
    """The light of one picture.

    Args:
        lighting: the lamps that the vehicle carries, and the light that is everywhere.
        dust: the haze.
        is_metered: whether the gain follows the brightness of what is in view.
    """

    def __init__(self, lighting: Lighting, dust: Dust, *, is_metered: bool) -> None:
        self._lighting, self._dust = lighting, dust
        self.is_even = not lighting.lamps and dust.haze_per_m == 0.0
        """Whether all patches are lit alike: then the whole picture is to be multiplied with `rest`, and no patch."""
        self.rest = 1.0
        """What the whole picture is to be multiplied with."""
        if self.is_even:
            self.rest = 1.0 if is_metered else lighting.ambient
        self._gain = 0.0 if is_metered else 1.0
        self._beams: list[tuple[Lamp, Floats, Floats]] = []

    def move(self, body: Place) -> None:
        """Tells where the vehicle is."""
        center = np.array(body.position_m)
        for lamp in self._lighting.lamps:
            place = center + rotate(body.local_from_here, lamp.position_frd_m)
            self._beams.append((lamp, place, np.array(rotate(body.local_from_here, _unit(lamp)))))

    def glow(self, sheets: Sheets, patch: Patch, eye: Floats) -> Glow:
        """The light over a patch."""
        points = _grid_m(sheets, patch)
        normal = sheets.normals[patch.sheet]
        if (eye - patch.corner_m) @ normal < 0.0:
            normal = -normal
        factor = np.full(points.shape[:2], self._lighting.ambient)
        for lamp, place, direction in self._beams:
            factor += _lit(lamp, place, direction, points, normal)
        if self._dust.haze_per_m == 0.0:
            return Glow(factor.astype(np.float32), None)
        through = (1.0 - self._dust.haze_per_m) ** np.linalg.norm(points - eye, axis=2)
        veil = (1.0 - through) * self._dust.haze_grey
        return Glow((factor * through).astype(np.float32), veil.astype(np.float32))

    def meter(self, patches: list[Patch], glows: list[Glow]) -> None:
        """Sets the gain, once for the picture, so that what is in view is on the average as bright as its texture."""
        if self._gain > 0.0 or not patches:
            return
        areas = [(right - left) * (bottom - top) for left, top, right, bottom in (patch.region for patch in patches)]
        bright = sum(area * float(glow.factor.mean()) for area, glow in zip(areas, glows, strict=True)) / sum(areas)
        self._gain = min(max(1.0 / max(bright, 1e-6), _LEAST_GAIN), _MOST_GAIN)

    def apply(self, cv2: Any, drawn: Image, glow: Glow) -> Image:
        """A patch in this light."""
        size = (drawn.shape[1], drawn.shape[0])
        most = max(float(glow.factor.max()), 1e-6)
        share = cv2.resize(np.round(glow.factor * (255.0 / most)).astype(np.uint8), size)
        lit: Image = cv2.multiply(drawn, share, scale=most * self._gain / 255.0)
        if glow.veil is not None:
            veil = np.clip(np.round(glow.veil * self._gain), 0, 255).astype(np.uint8)
            lit = cv2.add(lit, cv2.resize(veil, size))
        return lit


def _unit(lamp: Lamp) -> Vector3:
    x, y, z = np.array(lamp.direction_frd) / np.linalg.norm(lamp.direction_frd)
    return (float(x), float(y), float(z))


def _lit(lamp: Lamp, place: Floats, direction: Floats, points: Floats, normal: Floats) -> Floats:
    """What a lamp adds: inverse square, angle of incidence, and a beam that has halved at half its full angle."""
    away = points - place
    distance = np.maximum(np.linalg.norm(away, axis=2), _NEAR_M)
    square_on = np.abs(away @ normal) / distance
    ahead = np.maximum(away @ direction / distance, 0.0)
    power = np.log(0.5) / np.log(max(cos(radians(lamp.beam_deg / 2.0)), 1e-3))
    found: Floats = lamp.strength * square_on * ahead**power / distance**2
    return found


def _grid_m(sheets: Sheets, patch: Patch) -> Floats:
    """Places in the world at the middles of the cells of a coarse grid over a patch, shape `(rows, columns, 3)`."""
    left, top, right, bottom = patch.region
    columns, rows = max(2, (right - left) // _CELL_PX), max(2, (bottom - top) // _CELL_PX)
    across = left - 0.5 + (np.arange(columns) + 0.5) * (right - left) / columns
    down = top - 0.5 + (np.arange(rows) + 0.5) * (bottom - top) / rows
    matrix = patch.m_from_image
    depth = np.outer(down, np.full(columns, matrix[2, 1])) + matrix[2, 0] * across + matrix[2, 2]
    sign = np.sign(float(matrix[2] @ [*_middle(patch), 1.0]))
    depth = np.maximum(depth * sign, 1e-4) * sign  # beyond the horizon of the plane nothing is drawn
    right_m = (matrix[0, 0] * across + matrix[0, 1] * down[:, None] + matrix[0, 2]) / depth
    down_m = (matrix[1, 0] * across + matrix[1, 1] * down[:, None] + matrix[1, 2]) / depth
    index = patch.sheet
    found: Floats = patch.corner_m + right_m[..., None] * sheets.across[index] + down_m[..., None] * sheets.down[index]
    return found


def _middle(patch: Patch) -> tuple[float, float]:
    count = len(patch.outline_px)
    return sum(c for c, _ in patch.outline_px) / count, sum(r for _, r in patch.outline_px) / count
