"""Draws a world's rectangles as a pinhole camera sees them: one homography each, from far to near."""

from math import floor, log2
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gloc3.frames import Vector3
from gloc3_sitl.world.model import Marker, Surface
from gloc3_sitl.world.texture import MARKER_CELLS, MARKER_PIXELS_PER_CELL, Image, paint, paint_marker
from gloc3_sitl.world.world import World

Matrix = NDArray[np.float64]

_NEAR_M: Final = 0.02
_SMALL_PX: Final = 96
_RIM_PX: Final = 2


class _Sheet:
    """One rectangle with its texture at full, half, quarter… resolution."""

    def __init__(self, cv2: Any, surface: Surface, texture: Image, pixels_per_m: float, *, is_repeated: bool) -> None:
        across, down = np.array(surface.across_m, float), np.array(surface.down_m, float)
        self.corner_m: Matrix = np.array(surface.corner_m, float)
        self.width_m, self.height_m = float(np.linalg.norm(across)), float(np.linalg.norm(down))
        self.across: Matrix = across / self.width_m
        self.down: Matrix = down / self.height_m
        self.corners_m: Matrix = np.array(
            [self.corner_m, self.corner_m + across, self.corner_m + across + down, self.corner_m + down]
        )
        self.pixels_per_m = pixels_per_m
        self.period_px = (texture.shape[1], texture.shape[0]) if is_repeated else None
        picture: Image = np.tile(texture, (2, 2)) if is_repeated else texture
        levels = [picture]
        while min(levels[-1].shape) > _SMALL_PX and all(side % 2 == 0 for side in levels[-1].shape):
            levels.append(cv2.resize(levels[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
        # A rim keeps what lies beyond the edge out of the interpolation: OpenCV is ten times slower with any other border.
        border = cv2.BORDER_WRAP if is_repeated else cv2.BORDER_REPLICATE
        self.bare_levels = levels
        self.levels = [cv2.copyMakeBorder(level, _RIM_PX, _RIM_PX, _RIM_PX, _RIM_PX, border) for level in levels]


class Renderer:
    """Draws one world in grey; textures are painted when it is made.

    Args:
        world: What to draw.
        intrinsics: The camera's matrix, 3 by 3, in pixels; pixel centres have whole coordinates.
        width: Columns of the picture.
        height: Rows of the picture.
    """

    def __init__(self, world: World, intrinsics: Matrix, width: int, height: int) -> None:
        import cv2

        self._cv2: Any = cv2
        self._intrinsics = intrinsics
        self._size = (width, height)
        textures = world.file.textures
        ambient = world.file.lighting.ambient
        painted = {name: _lit(paint(texture), ambient) for name, texture in textures.items()}
        self._sheets = []
        for surface in world.surfaces:
            texture = textures[surface.texture]
            lengths = [float(np.linalg.norm(side)) for side in (surface.across_m, surface.down_m)]
            is_repeated = any(length > size + 1e-6 for length, size in zip(lengths, texture.size_m, strict=True))
            picture = painted[surface.texture]
            sheet = _Sheet(cv2, surface, picture, texture.resolution_px_m, is_repeated=is_repeated)
            self._sheets.append(sheet)
        self._tags = [_tag(cv2, world.marker, ambient)] if world.marker is not None else []
        columns, rows = np.array([-0.5, width - 0.5]), np.array([-0.5, height - 0.5])
        self._planes = _view_planes(intrinsics, columns, rows)

    def draw(self, rdf_from_local: Matrix, camera_m: Vector3) -> Image:
        """The picture from a place.

        Args:
            rdf_from_local: Rotation, 3 by 3.
            camera_m: The optical centre, `[x, y, height]`.
        """
        width, height = self._size
        image: Image = np.zeros((height, width), np.uint8)
        eye: Matrix = np.array(camera_m)
        seen = []
        for sheet in self._sheets:
            polygon = _clip((sheet.corners_m - eye) @ rdf_from_local.T, self._planes)
            if len(polygon) >= 3:
                seen.append((float(polygon[:, 2].mean()), sheet, polygon))
        seen.sort(key=lambda item: -item[0])
        for sheet in self._tags:
            polygon = _clip((sheet.corners_m - eye) @ rdf_from_local.T, self._planes)
            if len(polygon) >= 3:
                seen.append((0.0, sheet, polygon))
        for _, sheet, polygon in seen:
            self._draw_sheet(image, sheet, polygon, rdf_from_local, eye)
        return image

    def _draw_sheet(self, image: Image, sheet: _Sheet, polygon: Matrix, rotation: Matrix, eye: Matrix) -> None:
        cv2, (width, height) = self._cv2, self._size
        on_image = (polygon / polygon[:, 2:]) @ self._intrinsics.T
        left, top = np.maximum(np.floor(on_image[:, :2].min(axis=0)), 0).astype(int)
        right, bottom = np.minimum(np.ceil(on_image[:, :2].max(axis=0)) + 1, (width, height)).astype(int)
        if right <= left or bottom <= top:
            return
        image_from_m = self._intrinsics @ rotation @ np.column_stack([sheet.across, sheet.down, sheet.corner_m - eye])
        m_from_image = np.linalg.inv(image_from_m)
        middle = on_image.mean(axis=0)
        here, beside = (m_from_image @ np.array([middle[0] + step, middle[1], 1.0]) for step in (0.0, 1.0))
        reach_m = float(np.linalg.norm(beside[:2] / beside[2] - here[:2] / here[2]))
        level = min(max(0, round(log2(max(reach_m * sheet.pixels_per_m, 1e-9)))), len(sheet.levels) - 1)
        texture = sheet.levels[level]
        scale = sheet.pixels_per_m / 2**level
        corners = np.array([[x, y, 1.0] for x in (left, right) for y in (top, bottom)]) @ m_from_image.T
        span_px = (corners[:, :2] / corners[:, 2:]) * scale
        shift_x = shift_y = -float(_RIM_PX)
        border = cv2.BORDER_CONSTANT
        if sheet.period_px is not None:
            least, most = span_px.min(axis=0), span_px.max(axis=0)
            period_x, period_y = (side / 2**level for side in sheet.period_px)
            shift_x += floor(float(least[0]) / period_x) * period_x
            shift_y += floor(float(least[1]) / period_y) * period_y
            rows, columns = texture.shape
            if most[0] - shift_x > columns or most[1] - shift_y > rows:
                texture, border = sheet.bare_levels[level], cv2.BORDER_WRAP
                shift_x, shift_y = shift_x + _RIM_PX, shift_y + _RIM_PX
        to_texture = np.array([[scale, 0.0, -0.5 - shift_x], [0.0, scale, -0.5 - shift_y], [0.0, 0.0, 1.0]])
        from_roi = np.array([[1.0, 0.0, left], [0.0, 1.0, top], [0.0, 0.0, 1.0]])
        cut = image[top:bottom, left:right]
        drawn = cv2.warpPerspective(
            texture,
            to_texture @ m_from_image @ from_roi,
            (right - left, bottom - top),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=border,
        )
        mask = np.zeros(cut.shape, np.uint8)
        outline = np.round((on_image[:, :2] - (left, top)) * 16.0).astype(np.int32)
        cv2.fillConvexPoly(mask, outline, 255, cv2.LINE_8, 4)
        cv2.copyTo(drawn, mask, cut)


def _lit(picture: Image, ambient: float) -> Image:
    return picture if ambient == 1.0 else np.clip(picture * ambient, 0, 255).astype(np.uint8)


def _tag(cv2: Any, marker: Marker, ambient: float) -> _Sheet:
    """The tag as a rectangle that is drawn on top of all others."""
    side_m = marker.size_m * MARKER_CELLS / 6.0
    x, y, height = marker.center_m
    surface = Surface(
        corner_m=(x + side_m / 2.0, y + side_m / 2.0, height),
        across_m=(0.0, -side_m, 0.0),
        down_m=(-side_m, 0.0, 0.0),
        texture="marker",
    )
    return _Sheet(
        cv2,
        surface,
        _lit(paint_marker(marker), ambient),
        MARKER_CELLS * MARKER_PIXELS_PER_CELL / side_m,
        is_repeated=False,
    )


def _view_planes(intrinsics: Matrix, columns: Matrix, rows: Matrix) -> list[tuple[Matrix, float]]:
    """Planes `normal . p >= distance` that bound what the camera sees, in camera axes."""
    left, right = (columns - intrinsics[0, 2]) / intrinsics[0, 0]
    up, low = (rows - intrinsics[1, 2]) / intrinsics[1, 1]
    return [
        (np.array([0.0, 0.0, 1.0]), _NEAR_M),
        (np.array([1.0, 0.0, -left]), 0.0),
        (np.array([-1.0, 0.0, right]), 0.0),
        (np.array([0.0, 1.0, -up]), 0.0),
        (np.array([0.0, -1.0, low]), 0.0),
    ]


def _clip(corners: Matrix, planes: list[tuple[Matrix, float]]) -> Matrix:
    """What of a convex polygon lies within all planes (Sutherland and Hodgman 1974)."""
    points = list(corners)
    for normal, distance in planes:
        sides = [float(normal @ point) - distance for point in points]
        kept = []
        for i, point in enumerate(points):
            before, now = sides[i - 1], sides[i]
            if (before >= 0.0) != (now >= 0.0):
                kept.append(points[i - 1] + (point - points[i - 1]) * (before / (before - now)))
            if now >= 0.0:
                kept.append(point)
        points = kept
        if not points:
            break
    return np.array(points).reshape(-1, 3)
