"""`gloc3 odometry stereo`: the stereo odometer on a data set, or its tracking on one camera alone."""

from collections import Counter
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from gloc3.camera.geometry import Array, matrix
from gloc3.clock import Clock
from gloc3.errors import Refused
from gloc3.evaluation.trajectory import Trajectory
from gloc3.messages.vehicle import Image
from gloc3_onboard.algorithms.odometry.chain import OdometryChain
from gloc3_onboard.cli.odometry_report import Cost, ReportOptions, report
from gloc3_onboard.datasets.stereo_set import MonoSet, StereoSet, read_mono_set, read_stereo_set, times_of

WARMED_UP = 2
"""The first pictures also load libraries."""


def stereo(
    dataset: Path,
    /,
    *,
    options: ReportOptions | None = None,
    mono: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """Run the stereo odometer on a folder of EuRoC's kind (mav0/cam0, cam1) or KITTI's (calib.txt, image_0, image_1).

    The trajectory has the data set's own times, and for the body the axes that its truth has: EuRoC's inertial unit,
    KITTI's left camera. Where the odometer has no valid output the body is held to go on as before.

    Args:
        dataset: The folder.
        options: What to compare with, and how.
        mono: Track the left camera alone: it measures turns, and a path whose steps all count 1 m.
    """
    options = options or ReportOptions()
    options.check()
    if mono:
        one = read_mono_set(dataset)
        estimate, cost = run_mono(one)
        return report(estimate, options, cost, times_of(one.pictures))
    both = read_stereo_set(dataset)
    estimate, cost = run_stereo(both)
    return report(estimate, options, cost, times_of(both.pairs))


def run_stereo(given: StereoSet) -> tuple[Trajectory, Cost]:
    """The odometer's trajectory, and its cost.

    Raises:
        Refused: the cameras do not make a pair, or there are no pictures.
    """
    from gloc3_onboard.algorithms.vision.feature_message import odometry_of
    from gloc3_onboard.algorithms.vision.stereo_odometry import StereoOdometer

    odometer, chain, notes = StereoOdometer(given.left, given.right), OdometryChain(), _Notes()
    poses = []
    for record in given.pairs:
        left, right = record.load()
        begin_s = Clock.cost_s()
        motion = odometer.update(_array(left), _array(right), record.log_s)
        notes.add(Clock.cost_s() - begin_s, left.reason or right.reason or motion.reason)
        chain.add(odometry_of(motion, "stereo"), record.log_s)
        poses.append((np.array(chain.position_m), matrix(chain.attitude)))
    return _trajectory(times_of(given.pairs), poses, given.frd_from_own), notes.cost()


def run_mono(given: MonoSet) -> tuple[Trajectory, Cost]:
    """The same for one camera; every step has a length of 1 m, because the scale is unknown.

    Raises:
        Refused: there are no pictures.
    """
    from gloc3_onboard.algorithms.vision.mono_motion import MonoTracker

    tracker, notes = MonoTracker(given.camera), _Notes()
    position, rotation = np.zeros(3), np.eye(3)
    poses = []
    for record in given.pictures:
        image = record.load()
        begin_s = Clock.cost_s()
        motion = tracker.update(_array(image), record.log_s)
        notes.add(Clock.cost_s() - begin_s, image.reason or motion.reason)
        position, rotation = position + rotation @ motion.direction, rotation @ motion.rotation
        poses.append((position, rotation))
    return _trajectory(times_of(given.pictures), poses, given.frd_from_own), notes.cost()


class _Notes:
    """What a run took."""

    def __init__(self) -> None:
        self._costs_ms: list[float] = []
        self._reasons: Counter[str] = Counter()

    def add(self, cost_s: float, reason: str) -> None:
        self._costs_ms.append(1e3 * cost_s)
        self._reasons.update([reason] if reason else [])

    def cost(self) -> Cost:
        if not self._costs_ms:
            raise Refused("there are no pictures in the data set")
        warm_ms = self._costs_ms[WARMED_UP:] or self._costs_ms
        return Cost(
            inputs=len(self._costs_ms),
            valid=len(self._costs_ms) - self._reasons.total(),
            mean_ms=sum(warm_ms) / len(warm_ms),
            worst_ms=max(warm_ms),
            reasons=dict(self._reasons),
        )


def _array(image: Image) -> "np.ndarray[tuple[int, int], np.dtype[np.uint8]]":
    if len(image.data) != image.width * image.height:
        return np.zeros((0, 0), np.uint8)
    return np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)


def _trajectory(times_s: Array, poses: list[tuple[Array, Array]], frd_from_own: Array) -> Trajectory:
    return Trajectory(
        t_s=times_s,
        position_m=np.array([position for position, _ in poses]) @ frd_from_own,
        world_from_body=np.array([frd_from_own.T @ rotation @ frd_from_own for _, rotation in poses]),
    )
