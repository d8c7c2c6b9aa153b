"""External tracker: a fixed camera, exposed for lights, that sees the vehicle's light."""

from math import atan2, hypot
from typing import Final

import numpy as np

from gloc3.camera.geometry import matrix, project
from gloc3.camera.model import CameraModel
from gloc3.messages.frames import Quaternion, Vector3, conjugate, from_euler, multiply, normalize
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world.imager import Imager, Photo
from gloc3_sitl.world.model import CameraExposure, Tracker
from gloc3_sitl.world.placing import Placing, WorldPlacement
from gloc3_sitl.world.studio import Studio
from gloc3_sitl.world.texture import Image
from gloc3_sitl.world.world import World

LED_FRD_M: Final[Vector3] = (0.0, 0.0, -0.12)
"""Position of the light on the body, on a short mast."""
LED_RADIUS_M: Final = 0.015
TWIN_M: Final[Vector3] = (0.6, -0.8, 0.3)
"""Where a twin of the light is, from it."""
_GLARE_GREY: Final = 600.0
"""Grey value in the middle of a light, far beyond white; the glare widens it."""
_LEAST_SIGMA_PX: Final = 1.2
"""So wide is a point of light behind this lens."""
_LOCAL_FROM_LEVEL: Final[Quaternion] = (0.0, 1.0, 0.0, 0.0)
"""Axes (forward along x, right, down) of a level stand in the world's frame."""


class TrackerCamera:
    """The tracker's camera. A picture is a function of the truth and the seed, not of earlier pictures.

    Args:
        world: scene.
        tracker: its placement.
        model: its lens; its axes are those of a stand that points along the tracker's view.
        imager: rate, noise and sensitivity.
        seed: of the noise.
    """

    def __init__(self, world: World, tracker: Tracker, model: CameraModel, imager: Imager, seed: int = 0) -> None:
        self.model: Final = model
        self.imager: Final = imager
        self.is_lit = True
        """Whether the light of the vehicle is on."""
        self.has_twin = False
        """Whether another light shines beside it."""
        self._world, self._seed = world, seed
        self._placing = Placing(world)
        dx, dy, dz = (b - a for a, b in zip(tracker.position_m, tracker.look_at_m, strict=True))
        turn = from_euler(0.0, atan2(dz, hypot(dx, dy)), -atan2(dy, dx))
        self._stand = WorldPlacement(multiply(_LOCAL_FROM_LEVEL, turn), tracker.position_m)
        self._eye = self._stand.mounted(model.position_frd_m, model.frd_from_rdf)
        self._is_still = not any(box.shuttle for box in world.file.boxes.values())
        self._studio: Studio | None = None
        self._background: Image | None = None

    @property
    def position_ned_m(self) -> Vector3:
        """Position of the stand, in NED at the origin of the world's frame."""
        return self._world.frame.to_ned(self._stand.position_m)

    @property
    def ned_from_frd(self) -> Quaternion:
        """Attitude of the stand; forward is the viewing direction."""
        return normalize(multiply(conjugate(self._placing.local_from_ned), self._stand.local_from_here))

    def light_m(self, truth: Truth) -> Vector3:
        """Where the vehicle's light is, `[x, y, height]`."""
        return self._placing.body(truth).mounted(LED_FRD_M, (1.0, 0.0, 0.0, 0.0)).position_m

    def is_visible(self, point_m: Vector3, t_s: float) -> tuple[float, float, float] | None:
        """Column, row and depth at which a point shows; None if it is hidden, or out of the picture."""
        away = np.array(point_m) - self._eye.position_m
        in_camera = away @ matrix(self._eye.local_from_here)
        ((column, row),) = project(self.model, in_camera[None]).tolist()
        is_inside = -0.5 <= column <= self.model.width - 0.5 and -0.5 <= row <= self.model.height - 0.5
        if not is_inside or not self._world.geometry.is_clear(self._eye.position_m, np.array([point_m]), t_s)[0]:
            return None
        return column, row, float(in_camera[2])

    def capture(self, truth: Truth) -> Photo:
        """Take a picture."""
        if self._studio is None:
            self._studio = Studio(self._world, self.model, self.imager, CameraExposure(), self._seed)
        if self._background is None or not self._is_still:
            self._background = self._studio.scene([self._eye], None, truth.t_s)
        scene = self._background.copy()
        lights = [
            (light.position_m, light.radius_m) for light in self._world.file.lights.values() if light.is_on(truth.t_s)
        ]
        if self.is_lit:
            lights.append((self.light_m(truth), LED_RADIUS_M))
        if self.has_twin:
            x, y, height = self.light_m(truth)
            lights.append(((x + TWIN_M[0], y + TWIN_M[1], height + TWIN_M[2]), LED_RADIUS_M))
        for point_m, radius_m in lights:
            seen = self.is_visible(point_m, truth.t_s)
            if seen is not None:
                column, row, depth_m = seen
                _shine(scene, column, row, max(_LEAST_SIGMA_PX, radius_m * self.model.focal_px[0] / depth_m))
        return Photo(t_s=truth.t_s, pixels=self._studio.developed(scene, truth.t_s))


def _shine(scene: Image, column: float, row: float, sigma_px: float) -> None:
    """Adds a light to a scene."""
    half = int(4.0 * sigma_px) + 2
    left, top = max(0, round(column) - half), max(0, round(row) - half)
    cut = scene[top : round(row) + half + 1, left : round(column) + half + 1]
    across = np.exp(-((np.arange(left, left + cut.shape[1]) - column) ** 2) / (2.0 * sigma_px**2))
    down = np.exp(-((np.arange(top, top + cut.shape[0]) - row) ** 2) / (2.0 * sigma_px**2))
    cut[:] = np.minimum(cut + _GLARE_GREY * np.outer(down, across), 255.0).astype(np.uint8)
