"""A 60 m inspection flight over a floor: what the ground camera, a range finder and an attitude estimate give of it."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gloc3.evaluation.trajectory import Array, Trajectory, matrices_from_quaternions
from gloc3.messages.frames import Quaternion, from_euler, from_rotation_vector, multiply
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.probe import WorldProbe
from gloc3_sitl.world.rig import GROUND, GROUND_IMAGER
from gloc3_sitl.world.texture import Image
from gloc3_sitl.world.world import World

RATE_HZ = 15.0
SPEED_M_S = 0.5
STANDING_M = 0.10
HEIGHT_NOISE_M = 0.01
HEIGHT_BIAS_M = 0.01
HEIGHT_STEP_M = 0.01
TILT_NOISE_RAD = math.radians(0.1)
TILT_BIAS_RAD = math.radians(0.3)
YAW_DRIFT_RAD_S = 0.0005
WAY = ((2, 0, 1.0), (2, 0, 2.2), (2, 2, 2.2), (17, 2, 2.2), (17, 2, 3.5), (3, 2, 3.5), (3, 5, 2.5), (16, 5, 2.5))
WAY_BACK = ((16, 8, 2.5), (7, 8, 2.5))


class Step(NamedTuple):
    """One picture of a flight, and what was measured with it."""

    t_s: float
    picture: Image
    ned_from_frd: Quaternion
    """As it is believed: with noise, a constant tilt and a heading that drifts."""
    range_m: float
    """Along the body's down axis."""
    true_ned_m: tuple[float, float, float]
    true_ned_from_frd: Quaternion


class Motion(NamedTuple):
    """The true motion: times (n,), positions (n, 3) as x, y and height, roll, pitch and yaw (n, 3)."""

    times_s: Array
    positions_m: Array
    angles_rad: Array


def motion(seed: int, corners: tuple[tuple[float, float, float], ...] = (*WAY, *WAY_BACK)) -> Motion:
    """Along corners at a steady speed, rounded, with the sway of a hovering vehicle."""
    points = np.array(corners, float)
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    fine_s = np.arange(0.0, along[-1] / SPEED_M_S, 0.01)
    raw = np.column_stack([np.interp(fine_s * SPEED_M_S, along, points[:, axis]) for axis in range(3)])
    bell = np.hanning(141) / np.hanning(141).sum()
    padded = np.pad(raw, ((70, 70), (0, 0)), mode="edge")
    smooth = np.column_stack([np.convolve(padded[:, axis], bell, "valid") for axis in range(3)])
    times = np.arange(0.0, fine_s[-1], 1.0 / RATE_HZ)
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, 8)
    sway = 0.04 * np.column_stack(
        [np.sin(0.7 * times + phase[0]), np.sin(0.9 * times + phase[1]), 0.5 * np.sin(0.5 * times + phase[2])]
    )
    positions = np.column_stack([np.interp(times, fine_s, smooth[:, axis]) for axis in range(3)]) + sway
    tilt = np.radians(3.0) * np.column_stack([np.sin(2.1 * times + phase[3]), np.sin(1.7 * times + phase[4])])
    tilt += np.radians(1.0) * np.column_stack([np.sin(5.0 * times + phase[5]), np.sin(6.0 * times + phase[6])])
    yaw = math.radians(40.0) * np.sin(0.07 * times + phase[7])
    return Motion(times, positions, np.column_stack((tilt, yaw)))


def truths(world: World, path: Motion) -> Iterator[Truth]:
    """What the vehicle does at each time of a motion."""
    speed = np.gradient(path.positions_m, path.times_s, axis=0)
    turning = np.gradient(path.angles_rad, path.times_s, axis=0)
    for index, t_s in enumerate(path.times_s):
        yield _truth(world, float(t_s), path.positions_m[index], speed[index], path.angles_rad[index], turning[index])


def fly(seed: int, world: World, path: Motion | None = None) -> Iterator[Step]:
    """Takes the pictures of a flight one by one."""
    path = path or motion(seed)
    camera, probe = SimulatedCamera(world, GROUND, GROUND_IMAGER, seed), WorldProbe(world)
    random = np.random.default_rng([seed, 7])
    tilt_bias = TILT_BIAS_RAD * random.standard_normal(2)
    range_bias_m = HEIGHT_BIAS_M * random.standard_normal()
    for index, truth in enumerate(truths(world, path)):
        x, y, height = path.positions_m[index]
        roll, pitch, yaw = path.angles_rad[index]
        error = TILT_NOISE_RAD * random.standard_normal(2) + tilt_bias
        level = from_euler(0.0, 0.0, yaw + YAW_DRIFT_RAD_S * truth.t_s)
        tipped = multiply(from_rotation_vector((error[0], error[1], 0.0)), from_euler(roll, pitch, 0.0))
        range_m = probe(truth, 0.0) + range_bias_m + HEIGHT_NOISE_M * random.standard_normal()
        yield Step(
            t_s=truth.t_s,
            picture=camera.capture(truth).pixels,
            ned_from_frd=multiply(level, tipped),
            range_m=round(range_m / HEIGHT_STEP_M) * HEIGHT_STEP_M,
            true_ned_m=world.frame.to_ned((x, y, height)),
            true_ned_from_frd=truth.attitude_wxyz,
        )


def _truth(world: World, t_s: float, place: Array, speed: Array, angles: Array, turning: Array) -> Truth:
    x, y, height = (float(value) for value in place)
    latitude, longitude, altitude = world.frame.to_geo((x, y, height - STANDING_M))
    velocity = world.frame.to_ned((float(speed[0]), float(speed[1]), float(speed[2])))
    return Truth(
        t_s=t_s,
        position_ned_m=(0.0, 0.0, 0.0),
        velocity_ned_m_s=velocity,
        attitude_wxyz=from_euler(float(angles[0]), float(angles[1]), float(angles[2])),
        rate_frd_rad_s=(float(turning[0]), float(turning[1]), float(turning[2])),
        specific_force_frd_m_s2=(0.0, 0.0, -9.81),
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_m=altitude,
        height_above_ground_m=height - STANDING_M,
        standing_height_m=STANDING_M,
        is_on_ground=False,
        power_w=0.0,
        wind_ned_m_s=(0.0, 0.0, 0.0),
    )


def trajectory(
    times_s: list[float], places: list[tuple[float, float, float]], attitudes: list[Quaternion]
) -> Trajectory:
    """Poses as a trajectory."""
    return Trajectory(
        t_s=np.array(times_s),
        position_m=np.array(places),
        world_from_body=matrices_from_quaternions(np.array(attitudes)),
    )


def write_folder(steps: Iterator[Step], folder: Path) -> None:
    """Writes a flight as the data set that `gloc3 odometry ground` reads, and its truth in TUM form."""
    import cv2

    (folder / "ground" / "data").mkdir(parents=True)
    pictures, attitudes, heights, poses = ["#timestamp [ns],filename"], ["#t,q_w,q_x,q_y,q_z"], ["#t,height [m]"], []
    for step in steps:
        stamp = round(step.t_s * 1e9)
        cv2.imwrite(str(folder / "ground" / "data" / f"{stamp}.png"), step.picture)
        pictures.append(f"{stamp},{stamp}.png")
        attitudes.append(",".join([str(stamp), *(f"{value:.9f}" for value in step.ned_from_frd)]))
        heights.append(f"{stamp},{step.range_m:.4f}")
        w, x, y, z = step.true_ned_from_frd
        numbers = (step.t_s, *step.true_ned_m, x, y, z, w)
        poses.append(" ".join(f"{value:.9f}" for value in numbers))
    (folder / "ground" / "data.csv").write_text("\n".join(pictures) + "\n")
    (folder / "attitude.csv").write_text("\n".join(attitudes) + "\n")
    (folder / "height.csv").write_text("\n".join(heights) + "\n")
    (folder / "truth.txt").write_text("\n".join(poses) + "\n")
    (folder / "ground" / "sensor.yaml").write_text(SENSOR)


SENSOR = f"""sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, {GROUND.position_frd_m[2]}, 0, 0, 0, 1]
resolution: [{GROUND.width}, {GROUND.height}]
camera_model: pinhole
intrinsics: [{GROUND.focal_px[0]}, {GROUND.focal_px[1]}, {GROUND.center_px[0]}, {GROUND.center_px[1]}]
distortion_model: radial-tangential
distortion_coefficients: [0, 0, 0, 0]
"""
