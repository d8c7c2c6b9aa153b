"""`gloc3 odometry laser`: the laser odometer on a log."""

from collections import Counter
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from gloc3.camera.opencv import load_opencv
from gloc3.cli.narration import narrate
from gloc3.clock import Clock
from gloc3.errors import Refused
from gloc3.evaluation.trajectory import Trajectory
from gloc3_onboard.algorithms.scan_matching.laser_odometer import LaserMotion, LaserOdometer, LaserOdometerSettings
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.cli.odometry_laser_map import check_map_path, draw_map, laid_out
from gloc3_onboard.cli.odometry_report import Cost, ReportOptions, report
from gloc3_onboard.datasets.laser_log import INTERVAL_S, LaserLog
from gloc3_onboard.datasets.laser_logs import read_laser_log

LOGS = (".log", ".clf", ".gfs")
MOST_JITTER_S = 1.0
"""Times of a log are not believed to be more wrong."""
WARMED_UP = 3
"""The first scans also load libraries."""


def laser(
    dataset: Path,
    /,
    *,
    options: ReportOptions | None = None,
    wheels: Annotated[bool, Parameter(negative="--no-wheels")] = True,
    range_max: float | None = None,
    map_: Annotated[Path | None, Parameter(name="--map")] = None,
) -> int:
    """Run the laser odometer on a log of CARMEN (.log), GMapping (.gfs) or BreezySLAM (.dat).

    The trajectory has the log's own axes (x forward, y left) and, of a CARMEN log, the first of its two times. The truth
    may also be a corrected CARMEN log of the same scans.

    Args:
        dataset: The log, or a folder with one.
        options: What to compare with, and how.
        wheels: Expect each scan where the log's wheels tell; the estimate itself is the scans' alone, but for a direction
            that they do not tell, and for a scan that fits nowhere.
        range_max: A range at or past it, in metres, is nothing seen; usual for the kind of log if not given.
        map_: Close the loops of the drive afterwards, and write its map here: a YAML file as ROS 2's map server reads
            it, with its image beside it; north is ahead of the first scan. The trajectory is then that of the map.
    """
    options = options or ReportOptions()
    options.check()
    if range_max is not None and not 0.1 < range_max < float("inf"):
        raise Refused("--range-max must be above 0.1 metres")
    if map_ is not None:
        check_map_path(map_)
    log = read_laser_log(dataset, range_max)
    for text in missing_in(log, wheels=wheels):
        narrate(text)
    motions, cost = drive(log, wheels=wheels)
    poses = [motion.pose for motion in motions]
    if map_ is not None:
        poses, graph = laid_out(log, motions)
        draw_map(log, poses, map_)
        narrate(f"map: {len(graph.keys)} key scans, {graph.loops} loops closed, written to {map_}")
    estimate = trajectory_of(poses, log.times_s)
    truth = None
    if options.truth is not None and options.truth.suffix in LOGS:
        truth = _truth(read_laser_log(options.truth), log, str(options.truth))
    return report(estimate, options, cost, truth=truth)


def run_laser(log: LaserLog, *, wheels: bool) -> tuple[Trajectory, Cost]:
    """The odometer's trajectory of a log, and its cost."""
    motions, cost = drive(log, wheels=wheels)
    return trajectory_of([motion.pose for motion in motions], log.times_s), cost


def drive(log: LaserLog, *, wheels: bool) -> tuple[list[LaserMotion], Cost]:
    """What the odometer says of each scan of a log, and its cost."""
    load_opencv()
    odometer = odometer_for(log)
    motions: list[LaserMotion] = []
    costs_ms: list[float] = []
    reasons: Counter[str] = Counter()
    for logged, t_s in zip(log.scans, log.times_s, strict=True):
        begin_s = Clock.cost_s()
        motion = odometer.update(logged.scan, t_s, guess=logged.wheels if wheels else None)
        costs_ms.append(1e3 * (Clock.cost_s() - begin_s))
        motions.append(motion)
        reasons.update([motion.reason] if motion.reason else [])
    warm_ms = costs_ms[WARMED_UP:] or costs_ms
    cost = Cost(
        inputs=len(motions),
        valid=len(motions) - reasons.total(),
        mean_ms=sum(warm_ms) / len(warm_ms),
        worst_ms=max(warm_ms),
        reasons=dict(reasons),
    )
    return motions, cost


def odometer_for(log: LaserLog) -> LaserOdometer:
    """An odometer that knows how wrong the times of the log are."""
    usual_s = LaserOdometerSettings().stamp_jitter_s
    return LaserOdometer(LaserOdometerSettings(stamp_jitter_s=min(max(usual_s, log.jitter_s), MOST_JITTER_S)))


def missing_in(log: LaserLog, *, wheels: bool) -> list[str]:
    """What the log does not have, and what that means for the estimate."""
    found = []
    if not log.has_times:
        found.append(f"the log has no times in order: its scans count as {INTERVAL_S:g} s apart")
    elif log.jitter_s > 0.0:
        found.append(f"times of the log go back by up to {log.jitter_s:.2f} s: they are sorted")
    if wheels and not log.has_wheels:
        found.append("the log has no wheel odometry: where scans are far apart, some may be matched to a wrong place")
    return found


def trajectory_of(poses: list[Planar], times_s: list[float]) -> Trajectory:
    """Planar poses as a trajectory on the axes of logs: x forward, y left, z up."""
    table = np.array(poses).reshape(-1, 3)
    c, s = np.cos(-table[:, 2]), np.sin(-table[:, 2])
    none, one = np.zeros(len(poses)), np.ones(len(poses))
    turned = np.array([[c, -s, none], [s, c, none], [none, none, one]]).transpose(2, 0, 1)
    position = np.column_stack((table[:, 0], -table[:, 1], none))
    return Trajectory(t_s=np.array(times_s), position_m=position, world_from_body=turned)


def _truth(corrected: LaserLog, log: LaserLog, name: str) -> Trajectory:
    """The poses of a corrected log, scan by scan where it has as many, else by its times."""
    poses = [scan.pose for scan in corrected.scans if scan.pose is not None]
    if len(poses) < len(corrected.scans):
        raise Refused(f"{name} has no poses of its scans")
    is_same = len(poses) == len(log.scans)
    if not is_same and not (corrected.has_times and log.has_times):
        raise Refused(f"{name} has {len(poses)} scans, the data set {len(log.scans)}, and no times to compare them by")
    return trajectory_of(poses, log.times_s if is_same else corrected.times_s)
