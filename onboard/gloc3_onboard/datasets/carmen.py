"""Logs of the CARMEN toolkit (`FLASER`, `ROBOTLASER1`) and of GMapping (`.gfs`).

`FLASER n r1..rn x y theta odom_x odom_y odom_theta t host logger_t`: metres and radians, beams from the right (-90
degrees) to the left. In a corrected log the pose of a scan is the truth, and the wheels are in the `ODOM` lines, each
going on from the pose of the scan before. A log without `ODOM` lines is not asked for wheels: its poses may be the truth.
"""

from math import pi
from pathlib import Path
from typing import Final

from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.datasets.laser_log import LaserLog, Line, LoggedScan, lines_of, log_of, scan_of

RANGE_MAX_M: Final = 40.0
"""Farther than this the scanners of these logs do not see; they write their largest number."""


def read_carmen(path: Path, range_max_m: float = RANGE_MAX_M) -> LaserLog:
    """Reads a log; lines of other kinds are passed over.

    Raises:
        InputError: a line is damaged, or there is no scan.
    """
    scans: list[LoggedScan] = []
    last: Planar | None = None
    is_moved = False
    for line in lines_of(path):
        match line.words[0]:
            case "ODOM":
                last, is_moved = line.pose(1), True
            case "FLASER" | "ROBOTLASER1" as kind:
                found = _flaser(line, range_max_m) if kind == "FLASER" else _robot_laser(line)
                before = scans[-1].pose if scans else None
                wheels = before.inverse() @ last if before is not None and last is not None and is_moved else None
                scans.append(LoggedScan(stamp_s=found.stamp_s, scan=found.scan, pose=found.pose, wheels=wheels))
                is_moved = False
    return log_of(path, scans)


def _flaser(line: Line, range_max_m: float) -> LoggedScan:
    count = line.count(1)
    ranges = line.numbers(2, 2 + count, may_be_nan=True)
    # A log that was cut down has no times: the name of the host or the end of the line comes there.
    stamp_s = line.number(8 + count) if len(line.words) > 8 + count else 0.0
    scan = scan_of(ranges, -pi / 2.0, _step_rad(count), range_max_m)
    return LoggedScan(stamp_s=stamp_s, scan=scan, pose=line.pose(2 + count))


def _robot_laser(line: Line) -> LoggedScan:
    """`ROBOTLASER1 type start fov step max accuracy mode n r1..rn m e1..em laser_pose robot_pose (5 numbers) t …`."""
    start_rad, _, step_rad, range_max_m = line.numbers(2, 6).tolist()
    count = line.count(8)
    ranges = line.numbers(9, 9 + count, may_be_nan=True)
    behind = 10 + count + line.count(9 + count)
    scan = scan_of(ranges, start_rad, step_rad, range_max_m)
    return LoggedScan(stamp_s=line.number(behind + 11), scan=scan, pose=line.pose(behind))


def read_gfs(path: Path, range_max_m: float = RANGE_MAX_M) -> LaserLog:
    """Reads a log of GMapping: `LASER_READING n r1..rn x y theta t`, with the pose that the wheels tell.

    Raises:
        InputError: a line is damaged, or there is no scan.
    """
    scans: list[LoggedScan] = []
    before: Planar | None = None
    for line in lines_of(path):
        if line.words[0] != "LASER_READING":
            continue
        count = line.count(1)
        ranges = line.numbers(2, 2 + count, may_be_nan=True)
        wheels = line.pose(2 + count)
        motion = before.inverse() @ wheels if before is not None else None
        scan = scan_of(ranges, -pi / 2.0, _step_rad(count), range_max_m)
        scans.append(LoggedScan(stamp_s=line.number(5 + count), scan=scan, wheels=motion))
        before = wheels
    return log_of(path, scans)


def _step_rad(count: int) -> float:
    """Half a turn: both ends are there where the number of beams is odd (361), else the last is left out (360)."""
    return pi / max(count - count % 2, 1)
