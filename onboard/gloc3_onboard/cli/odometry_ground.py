"""`gloc3 odometry ground`: the ground odometer on a data set."""

from collections import Counter
from pathlib import Path
from typing import Final

import numpy as np

from gloc3.clock import Clock
from gloc3.errors import Refused
from gloc3.evaluation.trajectory import Trajectory, matrices_from_quaternions
from gloc3.messages.frames import Quaternion, Vector3
from gloc3.messages.perception import Odometry
from gloc3_onboard.algorithms.odometry.chain import OdometryChain
from gloc3_onboard.algorithms.vision.ground_odometer import GroundOdometer, GroundSettings
from gloc3_onboard.cli.odometry_report import Cost, ReportOptions, report
from gloc3_onboard.datasets.ground_folder import GroundFolder, GroundFrame, read_ground_folder

WARMED_UP: Final = 3
"""The first pictures also load libraries."""


def ground(
    dataset: Path,
    /,
    *,
    options: ReportOptions | None = None,
    camera: str = "ground",
    slant: bool = False,
    height_noise: float = 0.02,
    height_scale: float = 0.007,
) -> int:
    """Run the ground odometer on a data set: a camera that looks down, with attitude and height.

    The data set is a folder like EuRoC's: `ground/data.csv`, `ground/data/`, `ground/sensor.yaml` (its `T_BS` on a body
    forward, right, down), `attitude.csv` (nanoseconds, quaternion w x y z of the body on north, east, down) and `height.csv`
    (nanoseconds, metres from the body's origin down). The trajectory is north, east and down of the first picture.

    Args:
        dataset: The folder, or one that holds it as mav0.
        options: What to compare with, and how.
        camera: The folder of the camera.
        slant: Heights are measured along the body's down axis, not vertically.
        height_noise: Standard deviation of one height, in metres.
        height_scale: Standard deviation of the share by which all heights may be wrong.
    """
    if not (0.0 < height_noise < 10.0 and 0.0 <= height_scale < 1.0):
        raise Refused("--height-noise must be above 0 and below 10 m, --height-scale 0 to 1")
    options = options or ReportOptions()
    options.check()
    folder = read_ground_folder(dataset, camera)
    settings = GroundSettings(is_slant=slant, height_noise_m=height_noise, height_scale_std=height_scale)
    estimate, cost = run_ground(folder, settings)
    return report(estimate, options, cost)


def run_ground(folder: GroundFolder, settings: GroundSettings) -> tuple[Trajectory, Cost]:
    """The odometer's trajectory of a data set, and its cost."""
    odometer, chain = GroundOdometer(folder.camera, settings), OdometryChain()
    poses: list[tuple[float, Vector3, Quaternion]] = []
    costs_ms: list[float] = []
    reasons: Counter[str] = Counter()
    for frame in folder.frames:
        pixels = frame.pixels()
        begin_s = Clock.cost_s()
        found = _process_frame(odometer, frame, pixels)
        costs_ms.append(1e3 * (Clock.cost_s() - begin_s))
        if not poses and frame.ned_from_frd is not None:
            chain.attitude = frame.ned_from_frd
        if chain.add(found, frame.t_s):
            poses.append((frame.t_s, chain.position_m, chain.attitude))
        reasons.update([found.reason] if found.reason else [])
    warm_ms = costs_ms[WARMED_UP:] or costs_ms
    cost = Cost(
        inputs=len(folder.frames),
        valid=len(folder.frames) - reasons.total(),
        mean_ms=sum(warm_ms) / len(warm_ms),
        worst_ms=max(warm_ms),
        reasons=dict(reasons),
    )
    trajectory = Trajectory(
        t_s=np.array([t_s for t_s, _, _ in poses]),
        position_m=np.array([position for _, position, _ in poses]),
        world_from_body=matrices_from_quaternions(np.array([attitude for _, _, attitude in poses])),
    )
    return trajectory, cost


def _process_frame(
    odometer: GroundOdometer, frame: GroundFrame, pixels: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]
) -> Odometry:
    if pixels.size == 0:
        return odometer.without_picture(frame.t_s, "the picture cannot be read")
    if frame.ned_from_frd is None:
        return odometer.without_picture(frame.t_s, "there is no attitude at the time of the picture")
    return odometer.update(pixels, frame.t_s, frame.ned_from_frd, frame.height_m)
