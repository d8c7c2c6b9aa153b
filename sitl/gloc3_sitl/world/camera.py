"""A simulated camera on a vehicle: pose, pictures, and visibility of the tag."""

from collections import deque
from math import ceil, dist, hypot
from typing import Final

import numpy as np

from gloc3.camera.geometry import project
from gloc3.camera.model import CameraModel
from gloc3.messages.frames import Quaternion, Vector3, rotate_back
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world.imager import Imager, Photo
from gloc3_sitl.world.placing import Placing, WorldPlacement
from gloc3_sitl.world.studio import Studio
from gloc3_sitl.world.texture import Image
from gloc3_sitl.world.tinter import Tinter
from gloc3_sitl.world.world import World

_BLUR_STEP_PX: Final = 1.0
_MOST_STEPS: Final = 12
_NEAR_M: Final = 0.3
_KEPT: Final = 8
"""So many of the last pictures may be coloured afterwards."""


class SimulatedCamera:
    """A camera in a world. Textures are painted at the first picture.

    A picture is a function of the truth, the models and the seed, not of earlier pictures. Other processors' vector
    units may differ by single grey values.

    Args:
        world: scene.
        model: lens, size and place on the body.
        imager: name, rate and noise.
        seed: of noise, dust and jumps of the exposure.
    """

    def __init__(self, world: World, model: CameraModel, imager: Imager, seed: int = 0) -> None:
        self.world: Final = world
        self.model: Final = model
        self.imager: Final = imager
        self._seed = seed
        self._placing = Placing(world)
        self._studio: Studio | None = None
        self._tinter: Tinter | None = None
        self.is_coloured = False
        """Whether it takes pictures in colour; the grey values are the same."""
        self._taken: deque[tuple[bytes, Truth]] = deque(maxlen=_KEPT)
        """The grey values of the last pictures, and what they were taken from."""

    def pose(self, truth: Truth) -> tuple[Quaternion, Vector3]:
        """`local_from_rdf` and the optical centre as `[x, y, height]`."""
        return self._placing.body(truth).mounted(self.model.position_frd_m, self.model.frd_from_rdf)

    def capture(self, truth: Truth) -> Photo:
        """Take a picture, with the shutter open around the time of the truth."""
        if self._studio is None:
            self._studio = Studio(self.world, self.model, self.imager, self.world.file.exposure, self._seed)
        bodies = [self._placing.body(truth, later_s) for later_s in self._moments_s(truth)]
        eyes = [self._eye(body) for body in bodies]
        scene = self._studio.scene(eyes, bodies[len(bodies) // 2], truth.t_s)
        pixels = self._studio.developed(scene, truth.t_s)
        bgr = self._tint(pixels, eyes[len(eyes) // 2], truth.t_s) if self.is_coloured else None
        return Photo(t_s=truth.t_s, pixels=pixels, bgr=bgr)

    def keep(self, data: bytes, truth: Truth) -> None:
        """Keeps what a picture was taken from, so that it may be coloured while it is one of the last."""
        self._taken.append((data, truth))

    def coloured(self, data: bytes) -> Image | None:
        """A picture that was kept, in colour, shape `(rows, columns, 3)`; None where these bytes are no such picture."""
        truth = next((truth for kept, truth in self._taken if kept is data), None)
        if truth is None:
            return None
        moments_s = self._moments_s(truth)
        pixels = np.frombuffer(data, np.uint8).reshape(self.model.height, self.model.width)
        eye = self._eye(self._placing.body(truth, moments_s[len(moments_s) // 2]))
        return self._tint(pixels, eye, truth.t_s)

    def _eye(self, body: WorldPlacement) -> WorldPlacement:
        return body.mounted(self.model.position_frd_m, self.model.frd_from_rdf)

    def _tint(self, pixels: Image, eye: WorldPlacement, t_s: float) -> Image:
        if self._tinter is None:
            self._tinter = Tinter(self.world, self.model)
        return self._tinter.coloured(pixels, eye, t_s)

    def _moments_s(self, truth: Truth) -> list[float]:
        """Sample times within the exposure, relative to its middle: one per pixel of image motion, s."""
        open_s = self.world.file.exposure.time_s
        if open_s == 0.0:
            return [0.0]
        near_m = max(self.world.geometry.clearance_m(self.pose(truth)[1], truth.t_s), _NEAR_M)
        turn_rad_s = hypot(*truth.rate_frd_rad_s) + hypot(*truth.velocity_ned_m_s) / near_m
        moved_px = turn_rad_s * open_s * max(self.model.focal_px)
        count = min(max(1, ceil(moved_px / _BLUR_STEP_PX)), _MOST_STEPS)
        return [((n + 0.5) / count - 0.5) * open_s for n in range(count)]

    def project(self, truth: Truth, point_m: Vector3) -> tuple[float, float] | None:
        """Column and row at which a point `[x, y, height]` appears, also beyond the picture; None if it is behind."""
        local_from_rdf, (cx, cy, cz) = self.pose(truth)
        seen = rotate_back(local_from_rdf, (point_m[0] - cx, point_m[1] - cy, point_m[2] - cz))
        if seen[2] <= 0.01:
            return None
        ((column, row),) = project(self.model, np.array([seen]))
        return float(column), float(row)

    def marker_corners_px(self, truth: Truth) -> list[tuple[float, float]] | None:
        """Where the corners of the tag's black square appear: far left, far right, near right, near left of the x axis."""
        marker = self.world.marker
        if marker is None:
            return None
        (x, y, height), half = marker.center_m, marker.size_m / 2.0
        corners = ((x + half, y + half), (x + half, y - half), (x - half, y - half), (x - half, y + half))
        found = [self.project(truth, (cx, cy, height)) for cx, cy in corners]
        return [place for place in found if place is not None] if None not in found else None

    def marker_in_view(self, truth: Truth, margin_px: float = 0.0, least_side_px: float = 16.0) -> bool:
        """Whether the whole black square of the tag is inside the picture and large enough to be read.

        Args:
            truth: Where the vehicle is.
            margin_px: Distance that the square must keep from the border of the picture.
            least_side_px: Least length of each side of the square. Occlusion by boxes is ignored.
        """
        corners = self.marker_corners_px(truth)
        if corners is None:
            return False
        width, height = self.model.width, self.model.height
        sides = (dist(corners[i - 1], corners[i]) for i in range(4))
        return min(sides) >= least_side_px and all(
            margin_px <= column <= width - 1 - margin_px and margin_px <= row <= height - 1 - margin_px
            for column, row in corners
        )
