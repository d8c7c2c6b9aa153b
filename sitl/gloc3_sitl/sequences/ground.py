"""Writes pictures of a downward camera, with attitude and height, in the format of `gloc3 odometry ground`."""

from collections.abc import Iterable
from math import radians
from pathlib import Path
from typing import Final

import numpy as np

from gloc3.messages.frames import IDENTITY, from_rotation_vector, multiply
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors import range_finder
from gloc3_sitl.sequences.euroc import camera_yaml, stamp_ns, write_lines, write_pictures
from gloc3_sitl.world import World, rig
from gloc3_sitl.world.camera import SimulatedCamera
from gloc3_sitl.world.placing import Placing
from gloc3_sitl.world.probe import WorldProbe

TILT_NOISE_RAD: Final = radians(0.1)
"""White noise of roll and pitch; the heading is exact."""


def write_ground(folder: Path, world: World, truths: Iterable[Truth], *, rate_hz: float = 15.0, seed: int = 0) -> int:
    """Writes a data set.

    Args:
        folder: gets `ground`, `attitude.csv`, `height.csv` (along the body's down axis, from its origin) and the truth,
            `truth.txt`, in TUM form: the body on north, east, down of the world's frame.
        world: scene.
        truths: vehicle state at each picture.
        rate_hz: of the pictures, for the calibration file.
        seed: of all noise.

    Returns:
        The number of pictures.
    """
    moments = list(truths)
    write_pictures(folder / "ground", SimulatedCamera(world, rig.GROUND, rig.GROUND_IMAGER, seed), moments)
    write_lines(folder / "ground" / "sensor.yaml", [camera_yaml("ground", rig.GROUND, rate_hz, IDENTITY)])
    random, probe, placing = np.random.default_rng([seed, 7]), WorldProbe(world), Placing(world)
    bias_m = range_finder.BIAS_M * random.standard_normal()
    attitudes, heights, poses = ["#timestamp [ns],q_w,q_x,q_y,q_z"], ["#timestamp [ns],height [m]"], list[str]()
    for moment in moments:
        roll, pitch = (TILT_NOISE_RAD * random.standard_normal(2)).tolist()
        reported = multiply(moment.attitude_wxyz, from_rotation_vector((roll, pitch, 0.0)))
        range_m = probe(moment, 0.0) + bias_m + range_finder.NOISE_M * random.standard_normal()
        attitudes.append(f"{stamp_ns(moment.t_s)},{','.join(f'{part:.9f}' for part in reported)}")
        heights.append(f"{stamp_ns(moment.t_s)},{range_m:.4f}")
        w, x, y, z = moment.attitude_wxyz
        place = world.frame.to_ned(placing.body(moment).position_m)
        seconds, rest_ns = divmod(stamp_ns(moment.t_s), 1_000_000_000)
        poses.append(f"{seconds}.{rest_ns:09d} " + " ".join(f"{part:.9f}" for part in (*place, x, y, z, w)))
    write_lines(folder / "attitude.csv", attitudes)
    write_lines(folder / "height.csv", heights)
    write_lines(folder / "truth.txt", poses)
    return len(moments)
