"""Flights with a stereo pair through the simulated hold: pictures and the true poses, the same for the same seed."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import pi

import numpy as np
from numpy.typing import NDArray

from gloc3.camera_geometry import matrix
from gloc3.camera_model import CameraModel
from gloc3.frames import from_euler
from gloc3.trajectory import Array, Trajectory
from gloc3_sitl.world.renderer import Renderer
from gloc3_sitl.world.world import World

RATE_HZ = 15.0
BASELINE_M = 0.15
NED_FROM_LOCAL = np.diag([1.0, -1.0, -1.0])
"""Of the hold, whose x points north: positions of the world are x, y to the left of it, height."""

Picture = NDArray[np.uint8]


def pair(width: int = 640, height: int = 480, focal_px: float = 400.0) -> tuple[CameraModel, CameraModel]:
    """The vehicle's front cameras."""
    left = CameraModel(
        width=width,
        height=height,
        focal_px=(focal_px, focal_px),
        center_px=((width - 1) / 2.0, (height - 1) / 2.0),
        position_frd_m=(0.1, -BASELINE_M / 2.0, 0.0),
    )
    right = CameraModel(
        width=width,
        height=height,
        focal_px=left.focal_px,
        center_px=left.center_px,
        position_frd_m=(0.1, BASELINE_M / 2.0, 0.0),
    )
    return left, right


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two pictures that were taken at one time."""

    t_s: float
    left: Picture
    right: Picture


def inspection(seed: int, length_m: float = 60.0, speed_m_s: float = 0.6) -> Trajectory:
    """Lanes along a wall of the hold and back across it, smooth, with the small tilts of a quadrotor; body in NED."""
    random = np.random.default_rng([seed, 1])
    corners = np.array(
        [
            [2, 1, 0.5],
            [2, 1, 1.5],
            [16, 1, 1.5],
            [17, 1.5, 3],
            [15, 1, 4],
            [3, 1, 4],
            [2, 3, 4.5],
            [4, 6, 4],
            [14, 7, 3],
            [16, 5, 2],
            [3, 4, 1.5],
        ],
        np.float64,
    ) + random.normal(0.0, 0.3, (11, 3)) * [[1.0, 1.0, 0.3]]
    looks = np.array([-90, -90, -90, -60, -90, -90, -20, 0, 10, -60, -150], np.float64) + random.normal(0.0, 8.0, 11)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    fine = np.arange(0.0, way[-1], 0.01)
    columns = [_smooth(np.interp(fine, way, column), 120) for column in (*corners.T, looks)]
    points = np.column_stack(columns[:3])
    gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    count = int(min(length_m, gone[-1]) / speed_m_s * RATE_HZ)
    t_s = np.arange(count) / RATE_HZ
    ramp_s = 1.5
    along = speed_m_s * np.where(t_s < ramp_s, t_s**2 / (2 * ramp_s), t_s - ramp_s / 2)
    local = np.column_stack([np.interp(along, gone, points[:, axis]) for axis in range(3)])
    yaw = np.radians(np.interp(along, gone, columns[3])) * -1.0
    phases = random.uniform(0.0, 2.0 * pi, 4)
    roll = 0.03 * np.sin(1.1 * t_s + phases[0]) + 0.01 * np.sin(5.0 * t_s + phases[1])
    pitch = 0.03 * np.sin(0.9 * t_s + phases[2]) + 0.01 * np.sin(4.0 * t_s + phases[3])
    return Trajectory(
        t_s=t_s,
        position_m=local @ NED_FROM_LOCAL.T,
        world_from_body=np.array([matrix(from_euler(*angles)) for angles in zip(roll, pitch, yaw, strict=True)]),
    )


def _smooth(values: Array, width: int) -> Array:
    kernel = np.hanning(2 * width + 1)
    padded = np.pad(values, width, mode="edge")
    return np.convolve(padded, kernel / kernel.sum(), mode="valid")


@lru_cache(maxsize=4)
def _renderer(world: str, camera: CameraModel) -> Renderer:
    intrinsics = np.array(
        [
            [camera.focal_px[0], 0.0, camera.center_px[0]],
            [0.0, camera.focal_px[1], camera.center_px[1]],
            [0.0, 0.0, 1.0],
        ]
    )
    return Renderer(World.load(world), intrinsics, camera.width, camera.height)


def draw(camera: CameraModel, position_ned_m: Array, ned_from_frd: Array, world: str = "hold") -> Picture:
    """What a camera of the body sees."""
    local_from_rdf = NED_FROM_LOCAL.T @ ned_from_frd @ matrix(camera.frd_from_rdf)
    x, y, height = (NED_FROM_LOCAL.T @ (position_ned_m + ned_from_frd @ np.array(camera.position_frd_m))).tolist()
    return _renderer(world, camera).draw(local_from_rdf.T, (x, y, height))


def fly(
    path: Trajectory, cameras: tuple[CameraModel, CameraModel], seed: int = 0, noise_grey: float = 1.5
) -> Iterator[Pair]:
    """The pictures of a flight."""
    random = np.random.default_rng([seed, 2])
    shape = (cameras[0].height + 64, cameras[0].width + 64)
    noise = np.round(random.normal(0.0, noise_grey, shape)).astype(np.int16)
    for t_s, position, rotation in zip(path.t_s.tolist(), path.position_m, path.world_from_body, strict=True):
        pictures = []
        for camera in cameras:
            down, across = random.integers(0, 64, 2)
            cut = noise[down : down + camera.height, across : across + camera.width]
            pictures.append(np.clip(draw(camera, position, rotation) + cut, 0, 255).astype(np.uint8))
        yield Pair(t_s=t_s, left=pictures[0], right=pictures[1])
