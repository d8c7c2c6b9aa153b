"""Brightness of a picture: lamps, haze and camera gain, on a coarse grid over each patch."""

from math import cos, log, radians
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import Vector3, rotate
from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.model import Dust, Lamp, Lighting
from gloc3_sitl.world.patches import Patch
from gloc3_sitl.world.placing import WorldPlacement
from gloc3_sitl.world.sheets import Sheets
from gloc3_sitl.world.texture import Image

_CELL_PX: Final = 16
_NEAR_M: Final = 0.3
_HORIZON: Final = 1e-4
_LEAST_GAIN: Final = 0.25
_MOST_GAIN: Final = 12.0


class Glow(NamedTuple):
    """The light over one patch, on a coarse grid."""

    factor: Floats
    """What the grey values of the texture are multiplied with."""
    veil: Floats | None
    """What haze adds, in grey values at a gain of 1."""


class SceneLight:
    """Illumination of one picture.

    Args:
        lighting: lamps on the vehicle and ambient light.
        dust: the haze.
        is_metered: whether the gain follows the brightness of the view.
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

    def move(self, body: WorldPlacement) -> None:
        """Tells where the vehicle is."""
        center = np.array(body.position_m)
        for lamp in self._lighting.lamps:
            place = center + rotate(body.local_from_here, lamp.position_frd_m)
            self._beams.append((lamp, place, np.array(rotate(body.local_from_here, _unit(lamp)))))

    def glows(self, sheets: Sheets, patches: list[Patch], eye: Floats) -> list[Glow]:
        """The light over each patch, worked out for all at once."""
        if not patches:
            return []
        grids = [_grid(patch) for patch in patches]
        owner = np.repeat(np.arange(len(patches)), [len(grid.pixels) for grid in grids])
        index = np.array([patch.sheet for patch in patches])[owner]
        points = _points_m(sheets, patches, grids, owner, index)
        factor = np.full(len(points), self._lighting.ambient)
        for lamp, place, direction in self._beams:
            factor += _lit(lamp, place, direction, points, sheets.normals[index])
        veil: Floats | None = None
        if self._dust.haze_per_m > 0.0:
            through = (1.0 - self._dust.haze_per_m) ** np.linalg.norm(points - eye, axis=1)
            factor *= through
            veil = (1.0 - through) * self._dust.haze_grey
        ends = np.cumsum([len(grid.pixels) for grid in grids]).tolist()
        return [
            Glow(factor[begin:end].reshape(grid.shape), None if veil is None else veil[begin:end].reshape(grid.shape))
            for grid, begin, end in zip(grids, [0, *ends], ends, strict=False)
        ]

    def meter(self, patches: list[Patch], glows: list[Glow]) -> None:
        """Sets the gain once per picture, so that the view is on average as bright as its texture."""
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


def _lit(lamp: Lamp, place: Floats, direction: Floats, points: Floats, normals: Floats) -> Floats:
    """What a lamp adds: inverse square, angle of incidence, and a beam that has halved at half its full angle."""
    away = points - place
    square = np.maximum((away * away).sum(axis=1), _NEAR_M**2)
    distance = np.sqrt(square)
    ahead = np.maximum(away @ direction / distance, 0.0)
    power = log(0.5) / log(max(cos(radians(lamp.beam_deg / 2.0)), 1e-3))
    found: Floats = lamp.strength * np.abs((away * normals).sum(axis=1)) / distance * ahead**power / square
    return found


class _Grid(NamedTuple):
    """A coarse grid over the region of a patch: the middles of its cells."""

    pixels: Floats
    """Column, row and 1, shape `(n, 3)`."""
    shape: tuple[int, int]
    """Rows and columns."""


def _grid(patch: Patch) -> _Grid:
    left, top, right, bottom = patch.region
    columns, rows = max(2, (right - left) // _CELL_PX), max(2, (bottom - top) // _CELL_PX)
    across = left - 0.5 + (np.arange(columns) + 0.5) * ((right - left) / columns)
    down = top - 0.5 + (np.arange(rows) + 0.5) * ((bottom - top) / rows)
    pixels = np.ones((rows, columns, 3))
    pixels[..., 0] = across
    pixels[..., 1] = down[:, None]
    return _Grid(pixels.reshape(-1, 3), (rows, columns))


def _points_m(
    sheets: Sheets, patches: list[Patch], grids: list[_Grid], owner: NDArray[np.int64], index: NDArray[np.int64]
) -> Floats:
    """World positions of the cells, shape `(n, 3)`; beyond the horizon of a plane, far away."""
    matrices = np.array([patch.m_from_image * _side(patch) for patch in patches])[owner]
    spots = np.einsum("nij,nj->ni", matrices, np.concatenate([grid.pixels for grid in grids]))
    spots /= np.maximum(spots[:, 2:], _HORIZON)
    corners = np.array([patch.corner_m for patch in patches])[owner]
    found: Floats = corners + spots[:, :1] * sheets.across[index] + spots[:, 1:2] * sheets.down[index]
    return found


def _side(patch: Patch) -> float:
    """The sign that makes the depth of visible points positive; a homography does not fix it."""
    column, row = patch.outline_px[0]
    g, h, i = patch.m_from_image[2].tolist()
    return 1.0 if g * column + h * row + i > 0.0 else -1.0
