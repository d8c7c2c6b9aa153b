"""Takes the pictures of one camera: draws the scene, blurs it, bends it as the lens does, exposes it, adds noise."""

from typing import Final
from zlib import crc32

import numpy as np

from gloc3.camera.geometry import matrix
from gloc3.camera.model import CameraModel
from gloc3.camera.opencv import load_opencv
from gloc3_sitl.world.grains import Grains
from gloc3_sitl.world.imager import Imager
from gloc3_sitl.world.light import Light
from gloc3_sitl.world.model import Exposure
from gloc3_sitl.world.optics import Canvas, Optics
from gloc3_sitl.world.patches import View
from gloc3_sitl.world.placing import Place
from gloc3_sitl.world.renderer import Renderer
from gloc3_sitl.world.sheets import Sheets
from gloc3_sitl.world.texture import Image
from gloc3_sitl.world.world import World

_NOISE_SPAN: Final = 256


class Studio:
    """Loads OpenCV, paints the textures, and then takes pictures.

    Args:
        world: what there is to see.
        model: the camera.
        imager: its name (each camera has noise of its own), noise and sensitivity.
        exposure: how it exposes.
        seed: of noise, dust and jumps of the exposure.
    """

    def __init__(self, world: World, model: CameraModel, imager: Imager, exposure: Exposure, seed: int) -> None:
        self._cv2 = load_opencv()
        self._world, self._model = world, model
        self._imager, self._exposure = imager, exposure
        self._seed, self._stream = seed, crc32(imager.name.encode())
        self._optics = Optics(model)
        sheets = Sheets(world)
        self._renderers = [Renderer(sheets, canvas.pinhole) for canvas in self._optics.canvases]
        self._grains = Grains(world.file.dust, seed)
        random = np.random.Generator(np.random.PCG64([seed, self._stream]))
        shape = (model.height + _NOISE_SPAN, model.width + _NOISE_SPAN)
        noise = np.round(random.standard_normal(shape, np.float32) * imager.noise_grey)
        self._brighter = np.clip(noise, 0, 255).astype(np.uint8)
        self._darker = np.clip(-noise, 0, 255).astype(np.uint8)

    def scene(self, eyes: list[Place], body: Place | None, t_s: float) -> Image:
        """What falls on the sensor, grey values, rows by columns.

        Args:
            eyes: the camera's places (axes right, down, forward) while the shutter is open; their mean is the picture.
            body: the place of the vehicle with its lamps (axes forward, right, down); None without them.
            t_s: the middle of the exposure.
        """
        light = Light(self._world.file.lighting, self._world.file.dust, is_metered=self._exposure.is_automatic)
        if body is not None:
            light.move(body)
        rotations = [matrix(eye.local_from_here).T for eye in eyes]
        canvases = []
        for canvas, renderer in zip(self._optics.canvases, self._renderers, strict=True):
            views = [
                View(canvas.face_from_rdf @ rotation, eye.position_m, t_s)
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

    def _drawn(self, canvas: Canvas, renderer: Renderer, view: View, light: Light) -> Image:
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
