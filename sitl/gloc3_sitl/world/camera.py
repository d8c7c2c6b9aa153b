"""A simulated camera: where it sits, what it sees, and whether the tag is in view."""

from math import dist, pi
from typing import Annotated, Final

import msgspec
import numpy as np

from gloc3.frames import Quaternion, Vector3, conjugate, from_euler, multiply, rotate, rotate_back
from gloc3_sitl.truth import Truth
from gloc3_sitl.world.model import Positive
from gloc3_sitl.world.renderer import Matrix, Renderer
from gloc3_sitl.world.texture import Image
from gloc3_sitl.world.world import World


class CameraModel(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A pinhole camera without distortion, and how it sits on the body."""

    name: str = "ground"
    """The camera's name."""
    width: Annotated[int, msgspec.Meta(ge=16, le=4096)] = 640
    """Columns."""
    height: Annotated[int, msgspec.Meta(ge=16, le=4096)] = 480
    """Rows."""
    focal_px: Positive = 400.0
    """Focal length; 400 of 640 columns see 77 by 62 degrees. The optical axis meets the middle of the picture."""
    rate_hz: Positive = 5.0
    """Pictures per second, for whoever asks for them."""
    position_frd_m: Vector3 = (0.0, 0.0, 0.07)
    """The optical centre, from the centre of gravity."""
    euler_deg: Vector3 = (0.0, 0.0, 90.0)
    """Roll, pitch and yaw of the camera's axes (right, down, forward) on the body's; (0, 0, 90) looks down, top ahead."""
    noise_grey: Annotated[float, msgspec.Meta(ge=0.0, le=50.0)] = 1.5
    """Standard deviation of each pixel's noise."""

    @property
    def frd_from_rdf(self) -> Quaternion:
        """Rotation of camera axes to body axes."""
        roll, pitch, yaw = self.euler_deg
        return from_euler(roll * pi / 180.0, pitch * pi / 180.0, yaw * pi / 180.0)

    @property
    def center_px(self) -> tuple[float, float]:
        """Where the optical axis meets the picture; pixel centres have whole coordinates."""
        return (self.width - 1) / 2.0, (self.height - 1) / 2.0


GROUND_CAMERA: Final = CameraModel()
"""The camera under the vehicle: 640 by 480, straight down."""


class Photo(msgspec.Struct, frozen=True, kw_only=True):
    """A picture and when it was taken."""

    t_s: float
    """Time of exposure."""
    pixels: Image
    """Grey values, rows by columns."""


class Camera:
    """A camera in a world. Textures are painted at the first picture; each picture then takes about a millisecond.

    Pictures are the same for the same machine, seed and order of calls; processors with other vector units may differ
    by single grey values.
    """

    def __init__(self, world: World, model: CameraModel = GROUND_CAMERA, seed: int = 0) -> None:
        self.world: Final = world
        self.model: Final = model
        self._random = np.random.Generator(np.random.PCG64([seed, 0xCA3E7A]))
        self._renderer: Renderer | None = None
        self._noise = np.zeros((0, 0), np.int16)
        bearing = world.frame.x_axis_bearing_deg * pi / 180.0
        # Local axes are those of NED turned by the bearing, then half a turn about x.
        self._local_from_ned = conjugate(multiply(from_euler(0.0, 0.0, bearing), (0.0, 1.0, 0.0, 0.0)))

    def pose(self, truth: Truth) -> tuple[Quaternion, Vector3]:
        """`local_from_rdf` and the optical centre as `[x, y, height]`."""
        local_from_frd = multiply(self._local_from_ned, truth.attitude_wxyz)
        x, y, height = self.world.local(truth.latitude_deg, truth.longitude_deg, truth.altitude_m)
        mx, my, mz = rotate(local_from_frd, self.model.position_frd_m)
        place = (x + mx, y + my, height + truth.standing_height_m + mz)
        return multiply(local_from_frd, self.model.frd_from_rdf), place

    def capture(self, truth: Truth) -> Photo:
        """Take a picture."""
        if self._renderer is None:
            focal_px, (column, row) = self.model.focal_px, self.model.center_px
            intrinsics: Matrix = np.array([[focal_px, 0.0, column], [0.0, focal_px, row], [0.0, 0.0, 1.0]])
            self._renderer = Renderer(self.world, intrinsics, self.model.width, self.model.height)
            shape = (self.model.height + 256, self.model.width + 256)
            noise = self._random.standard_normal(shape, np.float32) * self.model.noise_grey
            self._noise = np.round(noise).astype(np.int16)
        local_from_rdf, place = self.pose(truth)
        columns = [rotate_back(local_from_rdf, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
        pixels = self._renderer.draw(np.array(columns).T, place)
        if self.model.noise_grey > 0.0:
            down, across = self._random.integers(0, 256, 2)
            cut = self._noise[down : down + self.model.height, across : across + self.model.width]
            pixels = np.clip(pixels + cut, 0, 255).astype(np.uint8)
        return Photo(t_s=truth.t_s, pixels=pixels)

    def project(self, truth: Truth, point_m: Vector3) -> tuple[float, float] | None:
        """Column and row at which a point `[x, y, height]` appears, also beyond the picture; None if it is behind."""
        local_from_rdf, (cx, cy, cz) = self.pose(truth)
        right, down, forward = rotate_back(local_from_rdf, (point_m[0] - cx, point_m[1] - cy, point_m[2] - cz))
        if forward <= 0.01:
            return None
        column, row = self.model.center_px
        return column + self.model.focal_px * right / forward, row + self.model.focal_px * down / forward

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
            least_side_px: Least length of each side of the square. Boxes that hide the tag are not looked at.
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
