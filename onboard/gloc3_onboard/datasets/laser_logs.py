"""Opens a laser log of any form that is known."""

from math import pi
from pathlib import Path
from typing import Final

from gloc3.errors import Refused
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.datasets.breezy import read_breezy
from gloc3_onboard.datasets.laser_log import LaserLog, LaserLogLine, LoggedScan, file_of, lines_of, log_of, scan_of

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


def _flaser(line: LaserLogLine, range_max_m: float) -> LoggedScan:
    count = line.count(1)
    ranges = line.numbers(2, 2 + count, may_be_nan=True)
    # A log that was cut down has no times: the name of the host or the end of the line comes there.
    stamp_s = line.number(8 + count) if len(line.words) > 8 + count else 0.0
    scan = scan_of(ranges, -pi / 2.0, _step_rad(count), range_max_m)
    return LoggedScan(stamp_s=stamp_s, scan=scan, pose=line.pose(2 + count))


def _robot_laser(line: LaserLogLine) -> LoggedScan:
    """`ROBOTLASER1 type start fov step max accuracy mode n r1..rn m e1..em laser_pose robot_pose (5 numbers) t …`."""
    start_rad, _, step_rad, range_max_m = line.numbers(2, 6).tolist()
    count = line.count(8)
    ranges = line.numbers(9, 9 + count, may_be_nan=True)
    behind = 10 + count + line.count(9 + count)
    scan = scan_of(ranges, start_rad, step_rad, range_max_m)
    return LoggedScan(stamp_s=line.number(behind + 11), scan=scan, pose=line.pose(behind))


def read_gfs(path: Path, range_max_m: float = RANGE_MAX_M) -> LaserLog:
    """Reads a log of GMapping: `LASER_READING n r1..rn x y theta t`, with the pose from the wheels.

    Raises:
        InputError: a line is damaged, or the log has no scan.
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


_READERS = {".log": read_carmen, ".clf": read_carmen, ".gfs": read_gfs, ".dat": read_breezy}


def read_laser_log(dataset: Path, range_max_m: float | None = None) -> LaserLog:
    """Reads a log of the form given by its suffix.

    Args:
        dataset: the file, or a folder with one log.
        range_max_m: ranges from here on mean no echo; None for the default of the kind of log.

    Raises:
        Refused: the file does not exist, or its form is unknown.
        InputError: the log is damaged.
    """
    path = file_of(dataset)
    if not path.is_file():
        raise Refused(f"there is no file {path}")
    reader = _READERS.get(path.suffix)
    if reader is None:
        raise Refused(f"{path} is not a laser log of a known kind: {', '.join(_READERS)}")
    return reader(path) if range_max_m is None else reader(path, range_max_m)
