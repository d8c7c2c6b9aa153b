"""Visible patches of a world: parts of rectangles in painter's order."""

from collections.abc import Iterator
from math import floor, sqrt
from typing import Final, NamedTuple

import numpy as np

from gloc3.messages.frames import Vector3
from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.polygon import Polygon, clip_all, depth_bands, view_planes
from gloc3_sitl.world.sheets import Sheets

_BAND: Final = 2.0
"""Within a patch depths differ by this factor at most: each is drawn with the resolution of the texture that fits it."""
_GRAZING: Final = 0.02
"""Cosine of incidence below which a surface counts as edge-on."""
_EDGE_M: Final = 1e-9
"""An eye that is no farther from the plane of a rectangle sees nothing of it."""


class PatchView(NamedTuple):
    """Pose and time of a picture."""

    rdf_from_local: Floats
    """Rotation, 3 by 3."""
    eye_m: Vector3
    """The optical centre, `[x, y, height]`."""
    t_s: float = 0.0
    """The time, which decides where moving boxes are."""


class Pinhole(NamedTuple):
    """A picture without distortion; pixel centres have whole coordinates."""

    focal_px: tuple[float, float]
    center_px: tuple[float, float]
    width: int
    height: int


class Patch(NamedTuple):
    """A convex part of a rectangle."""

    sheet: int
    """Which rectangle."""
    outline_px: list[tuple[float, float]]
    """Columns and rows of its corners in the picture."""
    region: tuple[int, int, int, int]
    """Left, top, right and bottom of the part of the picture that holds it; right and bottom are past its end."""
    m_from_image: Floats
    """Homography from columns and rows to metres right and down on the rectangle."""
    corner_m: Floats
    """The rectangle's upper left corner in the world."""
    pixel_m: float
    """Width of a square with the area that the central pixel covers on the surface, m."""


class PatchFinder:
    """Finds the patches of one camera."""

    def __init__(self, sheets: Sheets, pinhole: Pinhole) -> None:
        self._sheets, self._pinhole = sheets, pinhole
        (focal_x, focal_y), (center_x, center_y) = pinhole.focal_px, pinhole.center_px
        self._intrinsics: Floats = np.array([[focal_x, 0.0, center_x], [0.0, focal_y, center_y], [0.0, 0.0, 1.0]])
        self._planes = view_planes(
            (-0.5 - center_x) / focal_x,
            (-0.5 - center_y) / focal_y,
            (pinhole.width - 0.5 - center_x) / focal_x,
            (pinhole.height - 0.5 - center_y) / focal_y,
        )
        self._plane_rows: Floats = np.array(self._planes)

    def patches(self, view: PatchView) -> Iterator[Patch]:
        """Returns all visible patches, from far to near."""
        sheets, eye = self._sheets, np.array(view.eye_m)
        corners = sheets.corners_at(view.t_s)
        in_camera = (corners - eye) @ view.rdf_from_local.T
        sides = in_camera @ self._plane_rows[:, :3].T - self._plane_rows[:, 3]
        seen = np.flatnonzero(~(sides < 0.0).all(axis=1).any(axis=1) & sheets.facing(corners, eye))
        away = corners[seen, 0] - eye
        off_m = np.abs((away * sheets.normals[seen]).sum(axis=1))
        seen, away, off_m = (rows[off_m > _EDGE_M] for rows in (seen, away, off_m))
        local_from_plane = np.stack([sheets.across[seen], sheets.down[seen], away], axis=2)
        m_from_image = np.linalg.inv(self._intrinsics @ view.rdf_from_local @ local_from_plane)
        place = {index: at for at, index in enumerate(seen.tolist())}
        for index in sheets.order(seen, corners, eye):
            polygon = clip_all([(x, y, z) for x, y, z in in_camera[index].tolist()], self._planes)
            at = place[index]
            for band in depth_bands(polygon, _BAND) if polygon else ():
                outline = self._outline(band)
                region = self._region(outline)
                if region is not None:
                    pixel_m = self._pixel_m(band, float(off_m[at]))
                    yield Patch(index, outline, region, m_from_image[at], corners[index, 0], pixel_m)

    def _outline(self, band: Polygon) -> list[tuple[float, float]]:
        (focal_x, focal_y), (center_x, center_y) = self._pinhole.focal_px, self._pinhole.center_px
        return [(center_x + focal_x * x / z, center_y + focal_y * y / z) for x, y, z in band]

    def _region(self, outline: list[tuple[float, float]]) -> tuple[int, int, int, int] | None:
        columns, rows = [column for column, _ in outline], [row for _, row in outline]
        left, top = max(0, floor(min(columns))), max(0, floor(min(rows)))
        right = min(self._pinhole.width, floor(max(columns)) + 2)
        bottom = min(self._pinhole.height, floor(max(rows)) + 2)
        return (left, top, right, bottom) if right > left and bottom > top else None

    def _pixel_m(self, band: Polygon, off_m: float) -> float:
        x, y, z = (sum(corner[axis] for corner in band) / len(band) for axis in range(3))
        cosine = max(off_m / max(sqrt(x * x + y * y + z * z), 1e-9), _GRAZING)
        return z / self._pinhole.focal_px[0] / sqrt(cosine)


def spot_m(patch: Patch, column: float, row: float) -> tuple[float, float]:
    """Point of a rectangle seen by a pixel: metres right and down of its upper left corner."""
    (a, b, c), (d, e, f), (g, h, i) = patch.m_from_image.tolist()
    depth = g * column + h * row + i
    return (a * column + b * row + c) / depth, (d * column + e * row + f) / depth
