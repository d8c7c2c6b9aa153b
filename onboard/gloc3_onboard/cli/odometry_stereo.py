"""`gloc3 odometry stereo`: the stereo odometer on a data set, or its tracking on one camera alone."""

from collections import Counter, deque
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

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
_IMU_AFTER_S: Final = 0.02
"""Samples so long after a pair of pictures are taken in before it, s."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class StereoOptions:
    """The settings of the components `features` and `stereo_odometry` that a data set may need."""

    imu: Annotated[bool, Parameter(negative=())] = False
    """Use the gyros of the inertial unit (mav0/imu0) between the pictures."""
    calibration_px: float = 0.0
    """Standard deviation of what the calibration is off by, in pixels; about 1.2 for pictures from elsewhere."""
    nearest_m: float = 0.4
    """Nearest that anything is expected to be, in metres; 3 for a car."""

    def check(self) -> None:
        """Checks the options, in the bounds of the components' settings.

        Raises:
            Refused: one is out of range.
        """
        for name, value, least, most in (
            ("calibration-px", self.calibration_px, 0.0, 5.0),
            ("nearest-m", self.nearest_m, 0.05, 100.0),
        ):
            if not least <= value <= most:
                raise Refused(f"--{name} must be from {least:g} to {most:g}")


def stereo(
    dataset: Path,
    /,
    *,
    options: ReportOptions | None = None,
    settings: StereoOptions | None = None,
    mono: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """Run the stereo odometer on a folder of EuRoC's kind (mav0/cam0, cam1) or KITTI's (calib.txt, image_0, image_1).

    The trajectory has the data set's own times, and for the body the axes that its truth has: EuRoC's inertial unit,
    KITTI's left camera. Where the odometer has no valid output the body is held to go on as before.

    Args:
        dataset: The folder.
        options: What to compare with, and how.
        settings: Settings of the odometer.
        mono: Track the left camera alone: it measures turns, and a path whose steps all count 1 m.
    """
    options = options or ReportOptions()
    options.check()
    settings = settings or StereoOptions()
    settings.check()
    if mono and settings != StereoOptions():
        raise Refused("--imu, --calibration-px and --nearest-m are for two cameras: leave them or --mono out")
    if mono:
        one = read_mono_set(dataset)
        estimate, cost = run_mono(one)
        return report(estimate, options, cost, times_of(one.pictures))
    both = read_stereo_set(dataset, with_imu=settings.imu)
    estimate, cost = run_stereo(both, settings)
    return report(estimate, options, cost, times_of(both.pairs))


def run_stereo(given: StereoSet, settings: StereoOptions | None = None) -> tuple[Trajectory, Cost]:
    """The odometer's trajectory, and its cost.

    Args:
        given: the pictures, and samples of an inertial unit if it is to be used.
        settings: of the odometer.

    Raises:
        Refused: the cameras do not make a pair, or there are no pictures.
    """
    from gloc3_onboard.algorithms.odometry.gyro_turn import GyroTurn
    from gloc3_onboard.algorithms.vision.feature_message import odometry_of
    from gloc3_onboard.algorithms.vision.features import MatcherOptions
    from gloc3_onboard.algorithms.vision.stereo_motion import MotionOptions
    from gloc3_onboard.algorithms.vision.stereo_odometry import StereoOdometer

    settings, gyro = settings or StereoOptions(), GyroTurn() if given.imu else None
    matching = MatcherOptions(nearest_m=settings.nearest_m)
    motions = MotionOptions(calibration_px=settings.calibration_px)
    odometer, chain, notes = StereoOdometer(given.left, given.right, matching, motions, gyro), OdometryChain(), _Notes()
    poses, samples = [], deque(given.imu)
    for record in given.pairs:
        while gyro is not None and samples and samples[0].log_s <= record.log_s + _IMU_AFTER_S:
            sample = samples.popleft()
            gyro.add(sample.log_s, sample.load().rate_frd_rad_s)
        left, right = record.load()
        begin_s = Clock.cost_s()
        motion = odometer.update(_array(left), _array(right), record.log_s)
        cost_s = Clock.cost_s() - begin_s
        notes.add(cost_s, "" if motion.is_valid else left.reason or right.reason or motion.reason)
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
