"""Flights with a stereo pair through the simulated hold: pictures and the true poses, the same for the same seed."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi

import numpy as np

from gloc3.camera.geometry import matrix
from gloc3.camera.model import CameraModel
from gloc3.evaluation.trajectory import Array, Trajectory, quaternions_from_matrices
from gloc3.messages.frames import from_euler
from gloc3_onboard.algorithms.vision.picture import Picture
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world import World
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.rig import FRONT_LEFT, FRONT_LEFT_IMAGER, FRONT_RIGHT, FRONT_RIGHT_IMAGER

RATE_HZ = 15.0
NED_FROM_LOCAL = np.diag([1.0, -1.0, -1.0])
"""Of the hold, whose x points north: positions of the world are x, y to the left of it, height."""


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
    views = np.array([-90, -90, -90, -60, -90, -90, -20, 0, 10, -60, -150], np.float64) + random.normal(0.0, 8.0, 11)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    fine = np.arange(0.0, way[-1], 0.01)
    columns = [_smooth(np.interp(fine, way, column), 120) for column in (*corners.T, views)]
    points = np.column_stack(columns[:3])
    lost = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    count = int(min(length_m, lost[-1]) / speed_m_s * RATE_HZ)
    t_s = np.arange(count) / RATE_HZ
    ramp_s = 1.5
    along = speed_m_s * np.where(t_s < ramp_s, t_s**2 / (2 * ramp_s), t_s - ramp_s / 2)
    local = np.column_stack([np.interp(along, lost, points[:, axis]) for axis in range(3)])
    yaw = np.radians(np.interp(along, lost, columns[3])) * -1.0
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


def truths(path: Trajectory, world: World) -> Iterator[Truth]:
    """The moments of a flight, with the speeds and turns that blur pictures."""
    velocity = np.gradient(path.position_m, path.t_s, axis=0)
    wxyz = quaternions_from_matrices(path.world_from_body)
    for n, (t_s, position) in enumerate(zip(path.t_s.tolist(), path.position_m, strict=True)):
        other = max(n - 1, 0), min(n + 1, len(path) - 1)
        turn = path.world_from_body[other[0]].T @ path.world_from_body[other[1]]
        rate = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2.0
        p, q, r = (rate / (path.t_s[other[1]] - path.t_s[other[0]])).tolist()
        x, y, height = (NED_FROM_LOCAL.T @ position).tolist()
        place = world.frame.to_geo((x, y, height))
        vn, ve, vd = velocity[n].tolist()
        w, i, j, k = wxyz[n].tolist()
        yield Truth(
            t_s=t_s,
            position_ned_m=(x, -y, -height),
            velocity_ned_m_s=(vn, ve, vd),
            attitude_wxyz=(w, i, j, k),
            rate_frd_rad_s=(p, q, r),
            specific_force_frd_m_s2=(0.0, 0.0, -9.81),
            latitude_deg=place.latitude_deg,
            longitude_deg=place.longitude_deg,
            altitude_m=place.altitude_m,
            height_above_ground_m=height,
            standing_height_m=0.0,
            is_on_ground=False,
            power_w=0.0,
            wind_ned_m_s=(0.0, 0.0, 0.0),
        )


def fly(
    path: Trajectory,
    world: str = "hold",
    seed: int = 0,
    models: tuple[CameraModel, CameraModel] = (FRONT_LEFT, FRONT_RIGHT),
) -> Iterator[Pair]:
    """The pictures of a flight."""
    place = World.load(world)
    left, right = (
        SimulatedCamera(place, model, imager, seed)
        for model, imager in zip(models, (FRONT_LEFT_IMAGER, FRONT_RIGHT_IMAGER), strict=True)
    )
    for truth in truths(path, place):
        yield Pair(t_s=truth.t_s, left=left.capture(truth).pixels, right=right.capture(truth).pixels)
