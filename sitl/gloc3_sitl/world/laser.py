"""Laser scanners, planar and 3D: rays against the world from a tilted vehicle, with noise and drop-outs."""

from math import pi, radians
from typing import Annotated, Final
from zlib import crc32

import msgspec
import numpy as np

from gloc3.camera.geometry import matrix
from gloc3.messages.frames import IDENTITY, Quaternion, Vector3, multiply
from gloc3.messages.perception import LaserScan, PointCloud
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world.geometry import Floats
from gloc3_sitl.world.model import Length, Positive, Share
from gloc3_sitl.world.placing import Placing, WorldPlacement
from gloc3_sitl.world.world import World

_FLU_FROM_FRD: Final[Quaternion] = (0.0, 1.0, 0.0, 0.0)
"""Half a turn about x: a scanner counts its angles to the left, seen from above."""


class LaserModel(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A scanner and its mount on the body. The defaults are a 30 m class scanner with a full turn."""

    name: str = "laser"
    """The scanner's name."""
    beams: Annotated[int, msgspec.Meta(ge=2, le=10_000)] = 360
    """Rays of one turn."""
    angle_min_rad: float = -pi
    """Angle of the first ray, counted to the left from straight ahead."""
    angle_step_rad: float = 2.0 * pi / 360.0
    """From one ray to the next."""
    range_min_m: Length = 0.1
    """What is nearer is not seen."""
    range_max_m: Positive = 30.0
    """What is farther is not seen."""
    noise_m: Length = 0.01
    """Standard deviation of a range."""
    drop_out: Share = 0.002
    """Share of rays that come back empty for no reason."""
    rate_hz: Positive = 10.0
    """Turns per second."""
    duration_s: Annotated[float, msgspec.Meta(ge=0.0, le=0.2)] = 0.0
    """Time from the first ray to the last, during which the vehicle moves, s; 0 for simultaneous rays."""
    position_frd_m: Vector3 = (0.0, 0.0, -0.08)
    """Position on the body."""
    frd_from_scanner: Quaternion = IDENTITY
    """Rotation of its axes (forward, right, down) to the body's."""


class LaserScanner:
    """A scanner on a vehicle in a world. A scan is a function of the truth and the seed, not of earlier scans."""

    def __init__(self, world: World, model: LaserModel, seed: int = 0) -> None:
        self.model: Final = model
        self._world, self._seed = world, seed
        self._stream = crc32(model.name.encode())
        self._placing = Placing(world)
        self._angles = model.angle_min_rad + np.arange(model.beams) * model.angle_step_rad
        ahead = np.array((np.cos(self._angles), np.sin(self._angles), np.zeros(model.beams))).T
        self._directions: Floats = ahead

    def pose(self, truth: Truth) -> WorldPlacement:
        """Where the scanner is, with axes forward, left and up."""
        return self._mounted(self._placing.body(truth))

    def true_ranges_m(self, truth: Truth) -> Floats:
        """Distance along each ray to its first hit, the last ray at the time of the truth; infinity for none."""
        origins, directions = self._rays(truth)
        return self._world.geometry.ranges(origins, directions, truth.t_s)

    def scan(self, truth: Truth) -> LaserScan:
        """One turn that ends at the truth, as reported by the scanner; rays without a return are at `range_max_m`."""
        model = self.model
        moment = max(0, round(truth.t_s * 1e6))
        random = np.random.Generator(np.random.PCG64([self._seed, self._stream, moment]))
        ranges = self.true_ranges_m(truth)
        lost = (ranges < model.range_min_m) | (random.random(model.beams) < model.drop_out)
        ranges = ranges + model.noise_m * random.standard_normal(model.beams)
        ranges = np.where(
            lost | ~(ranges < model.range_max_m), model.range_max_m, np.maximum(ranges, model.range_min_m)
        )
        return LaserScan(
            scanner=model.name,
            angle_min_rad=model.angle_min_rad,
            angle_step_rad=model.angle_step_rad,
            range_min_m=model.range_min_m,
            range_max_m=model.range_max_m,
            ranges_m=ranges.astype("<f4").tobytes(),
            duration_s=model.duration_s,
        )

    def _mounted(self, body: WorldPlacement) -> WorldPlacement:
        return body.mounted(self.model.position_frd_m, multiply(self.model.frd_from_scanner, _FLU_FROM_FRD))

    def _rays(self, truth: Truth) -> tuple[Floats, Floats]:
        """Origins and directions of the rays, in the world."""
        place = self.pose(truth)
        turned = self._directions @ matrix(place.local_from_here).T
        if self.model.duration_s == 0.0:
            return np.array(place.position_m), turned
        # The turn is short: place and direction change evenly in it.
        first = self._mounted(self._placing.body(truth, -self.model.duration_s))
        before = self._directions @ matrix(first.local_from_here).T
        share = np.linspace(0.0, 1.0, self.model.beams)[:, None]
        directions = before * (1.0 - share) + turned * share
        origins = np.array(first.position_m) * (1.0 - share) + np.array(place.position_m) * share
        return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


class LidarModel(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A 3D scanner on the body. The defaults are a scanner of 16 beams, with every tenth of its directions."""

    name: str = "lidar"
    """The scanner's name."""
    elevations_rad: tuple[float, ...] = tuple(radians(each) for each in range(-15, 16, 2))
    """Its beams, upwards."""
    columns: Annotated[int, msgspec.Meta(ge=2, le=10_000)] = 180
    """Directions of a turn, clockwise, the first one astern."""
    range_min_m: Length = 0.5
    """What is nearer is not seen."""
    range_max_m: Positive = 30.0
    """What is farther is not seen."""
    noise_m: Length = 0.02
    """Standard deviation of a range."""
    drop_out: Share = 0.002
    """Share of rays that come back empty for no reason."""
    rate_hz: Positive = 10.0
    """Turns per second; the vehicle moves during a turn."""
    position_frd_m: Vector3 = (0.0, 0.0, -0.1)
    """Position on the body."""


class LidarScanner:
    """A 3D scanner on a vehicle in a world. A turn is a function of the truth and the seed, not of earlier turns.

    Args:
        world: scene.
        model: beams, ranges, noise and place on the body.
        seed: of noise and drop-outs.
    """

    def __init__(self, world: World, model: LidarModel, seed: int = 0) -> None:
        self.model: Final = model
        self._world, self._seed = world, seed
        self._stream = crc32(model.name.encode())
        self._placing = Placing(world)
        azimuths, elevations = np.meshgrid(
            -pi + np.arange(model.columns) * (2.0 * pi / model.columns), model.elevations_rad, indexing="ij"
        )
        level = np.cos(elevations)
        directions = (level * np.cos(azimuths), level * np.sin(azimuths), -np.sin(elevations))
        self._directions: Floats = np.column_stack([each.ravel() for each in directions])
        ages = np.arange(model.columns - 1, -1, -1) / (model.columns * model.rate_hz)
        self._ages_s: Floats = np.repeat(ages, len(model.elevations_rad))

    def turn(self, truth: Truth) -> PointCloud:
        """One turn that ends at the truth, each point on the axes of the body at its own time, as a scanner reports it."""
        model = self.model
        random = np.random.Generator(np.random.PCG64([self._seed, self._stream, max(0, round(truth.t_s * 1e6))]))
        ranges = self._world.geometry.ranges(*self._rays(truth), truth.t_s)
        is_lost = (ranges < model.range_min_m) | (random.random(len(ranges)) < model.drop_out)
        ranges = ranges + model.noise_m * random.standard_normal(len(ranges))
        is_seen = ~is_lost & (ranges < model.range_max_m)
        points = ranges[is_seen, None] * self._directions[is_seen] + np.array(model.position_frd_m)
        return PointCloud(
            sensor=model.name,
            data=points.astype("<f4").tobytes(),
            origin_frd_m=model.position_frd_m,
            range_max_m=model.range_max_m,
            ages_s=self._ages_s[is_seen].astype("<f4").tobytes(),
        )

    def _rays(self, truth: Truth) -> tuple[Floats, Floats]:
        """Origins and directions of the rays, in the world: where the scanner was at each direction of its turn."""
        beams = len(self.model.elevations_rad)
        origins, directions = [], []
        for column, age_s in enumerate(self._ages_s[::beams].tolist()):
            place = self._placing.body(truth, -age_s).mounted(self.model.position_frd_m, IDENTITY)
            origins.append(np.broadcast_to(np.array(place.position_m), (beams, 3)))
            directions.append(self._directions[column * beams : (column + 1) * beams] @ matrix(place.local_from_here).T)
        return np.concatenate(origins), np.concatenate(directions)
