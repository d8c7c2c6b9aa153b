"""Draws a world's rectangles as a pinhole camera sees them: homographies, from far to near."""

from math import floor
from typing import Final

import numpy as np

from gloc3.camera.opencv import load_opencv
from gloc3_sitl.world.cloth import RIM_PX, Level
from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.light import Light
from gloc3_sitl.world.patches import Patch, Pinhole, View, Viewer, spot_m
from gloc3_sitl.world.sheets import Sheets
from gloc3_sitl.world.texture import Image

_MARGIN_PX: Final = 6.0
"""So far beyond its outline a patch may look on its texture: the pixels at the edge are only partly on it."""


class Renderer:
    """Draws one world in grey."""

    def __init__(self, sheets: Sheets, pinhole: Pinhole) -> None:
        self._cv2 = load_opencv()
        self._sheets, self._pinhole = sheets, pinhole
        self._viewer = Viewer(sheets, pinhole)

    def draw(self, view: View, light: Light | None = None) -> Image:
        """The picture from a place; what is not there is black.

        Args:
            view: where the camera is.
            light: the light; None for the textures as they are.
        """
        image: Image = np.zeros((self._pinhole.height, self._pinhole.width), np.uint8)
        patches = list(self._viewer.patches(view))
        if light is None or light.is_even:
            for patch in patches:
                self._paste(image, self._drawn(patch), patch)
            return image
        glows = light.glows(self._sheets, patches, np.array(view.eye_m))
        light.meter(patches, glows)
        for patch, glow in zip(patches, glows, strict=True):
            self._paste(image, light.apply(self._cv2, self._drawn(patch), glow), patch)
        return image

    def _drawn(self, patch: Patch) -> Image:
        """The region of a patch, all of it covered with its texture."""
        cv2 = self._cv2
        left, top, right, bottom = patch.region
        level = self._sheets.cloths[patch.sheet].level(patch.pixel_m)
        sheet, texture_from_m, border = self._placed(patch, level)
        from_region = np.array([[1.0, 0.0, left], [0.0, 1.0, top], [0.0, 0.0, 1.0]])
        drawn: Image = cv2.warpPerspective(
            sheet,
            texture_from_m @ patch.m_from_image @ from_region,
            (right - left, bottom - top),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=border,
        )
        return drawn

    def _placed(self, patch: Patch, level: Level) -> tuple[Image, Floats, int]:
        """The part of the cloth that a patch bears: the picture, the map of metres into it, the rule at its border."""
        cv2, scale = self._cv2, level.scale_px_m
        start_x, start_y = self._sheets.starts_m[patch.sheet]
        shift_x, shift_y = start_x * scale - 0.5, start_y * scale - 0.5
        if not self._sheets.cloths[patch.sheet].is_repeated:
            return level.sheet, _scaling(scale, shift_x + RIM_PX, shift_y + RIM_PX), cv2.BORDER_CONSTANT
        spots = [spot_m(patch, column, row) for column, row in patch.outline_px]
        columns, rows = [x * scale + shift_x for x, _ in spots], [y * scale + shift_y for _, y in spots]
        period_x, period_y = level.period_px
        back_x = floor((min(columns) - _MARGIN_PX) / period_x) * period_x
        back_y = floor((min(rows) - _MARGIN_PX) / period_y) * period_y
        down, across = level.sheet.shape
        shift_x, shift_y = shift_x - back_x, shift_y - back_y
        if max(columns) - back_x + _MARGIN_PX > across - RIM_PX or max(rows) - back_y + _MARGIN_PX > down - RIM_PX:
            return level.bare, _scaling(scale, shift_x, shift_y), cv2.BORDER_WRAP
        return level.sheet, _scaling(scale, shift_x + RIM_PX, shift_y + RIM_PX), cv2.BORDER_CONSTANT

    def _paste(self, image: Image, drawn: Image, patch: Patch) -> None:
        """Copies a region into the picture, as far as its patch reaches."""
        left, top, right, bottom = patch.region
        cut = image[top:bottom, left:right]
        mask = np.zeros(cut.shape, np.uint8)
        points = [[round((column - left) * 16.0), round((row - top) * 16.0)] for column, row in patch.outline_px]
        self._cv2.fillConvexPoly(mask, np.array(points, np.int32), 255, self._cv2.LINE_8, 4)
        self._cv2.copyTo(drawn, mask, cut)


def _scaling(scale: float, shift_x: float, shift_y: float) -> Floats:
    return np.array([[scale, 0.0, shift_x], [0.0, scale, shift_y], [0.0, 0.0, 1.0]])
