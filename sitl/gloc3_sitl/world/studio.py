"""Renders the pictures of one camera: drawing, blur, lens distortion, exposure and noise."""

from functools import lru_cache
from math import floor
from typing import Any, Final, NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.geometry import matrix, unproject
from gloc3.camera.model import CameraModel, Lens
from gloc3.camera.opencv import load_opencv
from gloc3_sitl.world.cloth import RIM_PX, TextureLevel
from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.imager import Imager
from gloc3_sitl.world.light import SceneLight
from gloc3_sitl.world.model import CameraExposure, Dust
from gloc3_sitl.world.patches import Patch, PatchFinder, PatchView, Pinhole, spot_m
from gloc3_sitl.world.placing import WorldPlacement
from gloc3_sitl.world.sheets import Sheets
from gloc3_sitl.world.texture import Image
from gloc3_sitl.world.world import World

_ONE_CANVAS_TAN: Final = 1.75
_RIM_PX: Final = 2
_FACES: Final = (
    ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
    ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)),
    ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
    ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)),
)
"""Axes (right, down, forward) of the sides of the cube: ahead, right, left, below, above."""
_MARGIN_PX: Final = 6.0
"""Margin around a patch's outline on its texture, px: edge pixels are only partly covered."""


class LensCanvas(NamedTuple):
    """A pinhole picture from which the lens draws part of its picture."""

    face_from_rdf: Floats
    """Rotation of the camera's axes to those of the canvas, 3 by 3."""
    pinhole: Pinhole
    maps: tuple[Any, Any] | None
    """Position of each pixel on the canvas, for OpenCV's `remap`; None where both are the same."""
    mask: NDArray[np.uint8] | None
    """Which pixels come from this canvas; None for all."""


class Optics:
    """The canvases of a camera, and how they become its picture; what the lens cannot show stays black.

    The scene is drawn undistorted on one to five canvases and warped once. A canvas is a pinhole picture at the
    resolution of the middle of the lens. One looks ahead; a lens that sees more than 60 degrees beside its axis has four
    more, on the sides of a cube round the eye.
    """

    def __init__(self, model: CameraModel) -> None:
        self._cv2 = load_opencv()
        self._model = model
        self.canvases: Final = self._canvases()
        """What has to be drawn for a picture."""

    def bend(self, canvases: list[Image]) -> Image:
        """The lens's picture, from the pictures on its canvases."""
        found: Image | None = None
        for canvas, drawn in zip(self.canvases, canvases, strict=True):
            part = drawn
            if canvas.maps is not None:
                part = self._cv2.remap(drawn, *canvas.maps, self._cv2.INTER_LINEAR)
            if canvas.mask is None:
                return part
            found = np.zeros_like(part) if found is None else found
            self._cv2.copyTo(part, canvas.mask, found)
        assert found is not None
        return found

    def _canvases(self) -> list[LensCanvas]:
        model = self._model
        if model.lens is Lens.PINHOLE:
            return [
                LensCanvas(np.eye(3), Pinhole(model.focal_px, model.center_px, model.width, model.height), None, None)
            ]
        columns, rows = np.meshgrid(np.arange(model.width, dtype=float), np.arange(model.height, dtype=float))
        flat = unproject(model, np.column_stack([columns.ravel(), rows.ravel()]))
        is_shown = np.isfinite(flat[:, 0]) & np.isfinite(flat[:, 1])
        views = np.column_stack([np.where(is_shown[:, None], flat, 0.0), np.ones(len(flat))])
        if is_shown.all() and np.abs(flat).max() < _ONE_CANVAS_TAN:
            return [self._canvas(np.eye(3), views, None)]
        towards = np.stack([views @ np.array(face[2]) for face in _FACES])
        best = np.where(is_shown, towards.argmax(axis=0), -1)
        return [self._canvas(np.array(face), views, best == n) for n, face in enumerate(_FACES) if (best == n).any()]

    def _canvas(self, face_from_rdf: Floats, looks: Floats, chosen: NDArray[np.bool_] | None) -> LensCanvas:
        model, cv2 = self._model, self._cv2
        (focal_x, focal_y), shape = model.focal_px, (model.height, model.width)
        seen = looks @ face_from_rdf.T
        inside = np.ones(len(seen), bool) if chosen is None else chosen
        depth = np.where(inside, seen[:, 2], 1.0)
        columns, rows = focal_x * seen[:, 0] / depth, focal_y * seen[:, 1] / depth
        left, top = float(columns[inside].min()) - _RIM_PX, float(rows[inside].min()) - _RIM_PX
        width = int(np.ceil(columns[inside].max() - left)) + 1 + _RIM_PX
        height = int(np.ceil(rows[inside].max() - top)) + 1 + _RIM_PX
        across, down = (
            (line - begin).reshape(shape).astype(np.float32) for line, begin in ((columns, left), (rows, top))
        )
        maps = cv2.convertMaps(across, down, cv2.CV_16SC2)
        mask = None if chosen is None else (chosen.reshape(shape) * np.uint8(255)).astype(np.uint8)
        return LensCanvas(face_from_rdf, Pinhole(model.focal_px, (-left, -top), width, height), maps, mask)


@lru_cache(maxsize=16)
def optics_of(model: CameraModel) -> Optics:
    """The optics of a camera, one for all flights of the process."""
    return Optics(model)


class Renderer:
    """Draws one world, in the channels of its sheets."""

    def __init__(self, sheets: Sheets, pinhole: Pinhole) -> None:
        self._cv2 = load_opencv()
        self._sheets, self._pinhole = sheets, pinhole
        self._viewer = PatchFinder(sheets, pinhole)

    def draw(self, view: PatchView, light: SceneLight | None = None) -> Image:
        """The picture from a place; empty areas are black.

        Args:
            view: camera placement.
            light: the light; None for the textures as they are.
        """
        image: Image = np.zeros((self._pinhole.height, self._pinhole.width, *self._sheets.channels), np.uint8)
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

    def _placed(self, patch: Patch, level: TextureLevel) -> tuple[Image, Floats, int]:
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
        down, across = level.sheet.shape[:2]
        shift_x, shift_y = shift_x - back_x, shift_y - back_y
        if max(columns) - back_x + _MARGIN_PX > across - RIM_PX or max(rows) - back_y + _MARGIN_PX > down - RIM_PX:
            return level.bare, _scaling(scale, shift_x, shift_y), cv2.BORDER_WRAP
        return level.sheet, _scaling(scale, shift_x + RIM_PX, shift_y + RIM_PX), cv2.BORDER_CONSTANT

    def _paste(self, image: Image, drawn: Image, patch: Patch) -> None:
        """Copies a region into the picture, as far as its patch reaches."""
        left, top, right, bottom = patch.region
        cut = image[top:bottom, left:right]
        mask = np.zeros(cut.shape[:2], np.uint8)
        points = [[round((column - left) * 16.0), round((row - top) * 16.0)] for column, row in patch.outline_px]
        self._cv2.fillConvexPoly(mask, np.array(points, np.int32), 255, self._cv2.LINE_8, 4)
        self._cv2.copyTo(drawn, mask, cut)


def _scaling(scale: float, shift_x: float, shift_y: float) -> Floats:
    return np.array([[scale, 0.0, shift_x], [0.0, scale, shift_y], [0.0, 0.0, 1.0]])


_NOISE_SPAN: Final = 256


class Studio:
    """Renders pictures; loads OpenCV and paints the textures first.

    Args:
        world: scene.
        model: the camera.
        imager: its name (the noise differs by camera), noise and sensitivity.
        exposure: exposure settings.
        seed: of noise, dust and jumps of the exposure.
    """

    def __init__(self, world: World, model: CameraModel, imager: Imager, exposure: CameraExposure, seed: int) -> None:
        self._cv2 = load_opencv()
        self._world, self._model = world, model
        self._imager, self._exposure = imager, exposure
        self._seed, self._stream = seed, crc32(imager.name.encode())
        self._optics = optics_of(model)
        sheets = Sheets(world)
        self._renderers = [Renderer(sheets, canvas.pinhole) for canvas in self._optics.canvases]
        self._grains = Grains(world.file.dust, seed)
        random = np.random.Generator(np.random.PCG64([seed, self._stream]))
        shape = (model.height + _NOISE_SPAN, model.width + _NOISE_SPAN)
        noise = np.round(random.standard_normal(shape, np.float32) * imager.noise_grey)
        self._brighter = np.clip(noise, 0, 255).astype(np.uint8)
        self._darker = np.clip(-noise, 0, 255).astype(np.uint8)

    def scene(self, eyes: list[WorldPlacement], body: WorldPlacement | None, t_s: float) -> Image:
        """Image on the sensor: grey values, rows by columns.

        Args:
            eyes: camera placements (axes right, down, forward) during the exposure; the picture is their mean.
            body: placement of the vehicle with its lamps (axes forward, right, down); None without them.
            t_s: the middle of the exposure.
        """
        light = SceneLight(self._world.file.lighting, self._world.file.dust, is_metered=self._exposure.is_automatic)
        if body is not None:
            light.move(body)
        rotations = [matrix(eye.local_from_here).T for eye in eyes]
        canvases = []
        for canvas, renderer in zip(self._optics.canvases, self._renderers, strict=True):
            views = [
                PatchView(canvas.face_from_rdf @ rotation, eye.position_m, t_s)
                for eye, rotation in zip(eyes, rotations, strict=True)
            ]
            canvases.append(self._mean([self._drawn(canvas, renderer, view, light) for view in views]))
        image = self._optics.bend(canvases)
        gain = light.rest * self._imager.sensitivity * self._jump(t_s)
        return image if gain == 1.0 else self._cv2.convertScaleAbs(image, alpha=gain)

    def developed(self, scene: Image, t_s: float) -> Image:
        """The picture of a scene, with the noise of its time."""
        if self._imager.noise_grey == 0.0:
            return scene
        moment = max(0, round(t_s * 1e6))
        down, across = np.random.Generator(np.random.PCG64([self._seed, self._stream, moment])).integers(
            0, _NOISE_SPAN, 2
        )
        cut = np.s_[down : down + self._model.height, across : across + self._model.width]
        noisy: Image = self._cv2.subtract(self._cv2.add(scene, self._brighter[cut]), self._darker[cut])
        return noisy

    def _drawn(self, canvas: LensCanvas, renderer: Renderer, view: PatchView, light: SceneLight) -> Image:
        image = renderer.draw(view, light)
        if self._grains:
            self._grains.draw(self._cv2, image, canvas.pinhole, view)
        return image

    def _mean(self, images: list[Image]) -> Image:
        if len(images) == 1:
            return images[0]
        total = np.zeros(images[0].shape, np.float32)
        for image in images:
            self._cv2.accumulate(image, total)
        mean: Image = self._cv2.convertScaleAbs(total, alpha=1.0 / len(images))
        return mean

    def _jump(self, t_s: float) -> float:
        """The factor by which the exposure is off at a time, the same for all cameras of a seed."""
        exposure = self._exposure
        if exposure.jump == 1.0:
            return 1.0
        slot = int(t_s / exposure.jump_every_s)
        share = np.random.Generator(np.random.PCG64([self._seed, 0xE45, slot])).uniform(-1.0, 1.0)
        return float(exposure.jump**share)


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

    def draw(self, cv2: Any, image: Image, pinhole: Pinhole, view: PatchView) -> None:
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

    def _seen(self, pinhole: Pinhole, view: PatchView) -> list[tuple[float, float, float]]:
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
