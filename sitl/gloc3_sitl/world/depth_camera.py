"""A depth camera: a ray for each pixel against the world, with noise that grows with the distance, and drop-outs."""

from typing import Final
from zlib import crc32

import msgspec
import numpy as np

from gloc3.camera.geometry import matrix, unproject
from gloc3.camera.model import CameraModel
from gloc3.messages.perception import DepthImage
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.model import Length, Positive, Share
from gloc3_sitl.world.placing import Placing
from gloc3_sitl.world.world import World

SCALE_M: Final = 0.001
"""Unit of a pixel."""


class DepthImager(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a depth camera measures, without its lens. The defaults are those of a stereo camera of the 50 mm class."""

    name: str = "depth"
    """The camera's name."""
    rate_hz: Positive = 10.0
    """Pictures per second."""
    range_min_m: Length = 0.3
    """What is nearer is not measured."""
    range_max_m: Positive = 10.0
    """What is farther away is not measured."""
    noise_m: Length = 0.004
    """Standard deviation of a depth of 1 m; it grows with the square of the depth."""
    drop_out: Share = 0.005
    """Share of pixels without a depth for no reason."""


class SimulatedDepthCamera:
    """A depth camera on a vehicle in a world. A picture is a function of the truth and the seed, not of earlier ones.

    Args:
        world: scene.
        model: lens, size and place on the body.
        imager: name, rate, ranges and noise.
        seed: of noise and drop-outs.
    """

    def __init__(self, world: World, model: CameraModel, imager: DepthImager, seed: int = 0) -> None:
        self.model: Final = model
        self.imager: Final = imager
        self._world, self._seed = world, seed
        self._stream = crc32(imager.name.encode())
        self._placing = Placing(world)
        columns, rows = np.meshgrid(np.arange(model.width), np.arange(model.height))
        flat = unproject(model, np.column_stack((columns.ravel(), rows.ravel())))
        rays = np.column_stack((flat, np.ones(len(flat))))
        self._lengths = np.linalg.norm(rays, axis=1)
        self._directions: Floats = rays / self._lengths[:, None]

    def true_depths_m(self, truth: Truth) -> Floats:
        """Distance along the optical axis of what each pixel shows, shape (height, width); infinity for nothing."""
        eye = self._placing.body(truth).mounted(self.model.position_frd_m, self.model.frd_from_rdf)
        directions = self._directions @ matrix(eye.local_from_here).T
        ranges = self._world.geometry.ranges(np.array(eye.position_m), directions, truth.t_s)
        depths: Floats = (ranges / self._lengths).reshape(self.model.height, self.model.width)
        return depths

    def capture(self, truth: Truth) -> DepthImage:
        """Takes a picture."""
        imager, depths = self.imager, self.true_depths_m(truth)
        moment = max(0, round(truth.t_s * 1e6))
        random = np.random.Generator(np.random.PCG64([self._seed, self._stream, moment]))
        is_lost = random.random(depths.shape) < imager.drop_out
        near = np.minimum(depths, 2.0 * imager.range_max_m)
        measured = near + imager.noise_m * near**2 * random.standard_normal(depths.shape)
        is_lost |= (depths < imager.range_min_m) | ~(measured <= imager.range_max_m)
        units = np.where(is_lost, 0.0, np.maximum(measured, imager.range_min_m) / SCALE_M)
        return DepthImage(
            camera=imager.name,
            width=self.model.width,
            height=self.model.height,
            data=np.rint(units).astype("<u2").tobytes(),
            scale_m=SCALE_M,
            range_min_m=imager.range_min_m,
            range_max_m=imager.range_max_m,
        )
