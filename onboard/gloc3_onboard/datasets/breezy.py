"""Logs of BreezySLAM: a Hokuyo URG-04LX on a rover with two wheels, one scan a line, whole numbers only.

Time in microseconds, then in words 3 and 4 the ticks of the left and the right wheel, from word 25 on the ranges in
millimetres from the right (-120 degrees) to the left; 0 is no echo.
"""

from math import pi, radians
from pathlib import Path
from typing import Final

import numpy as np
from msgspec.structs import replace

from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.datasets.laser_log import LaserLog, LoggedScan, lines_of, log_of, scan_of

BEAMS: Final = 682
FIRST: Final = 24
SPAN_RAD: Final = radians(240.0)
RANGE_MAX_M: Final = 5.6
WHEEL_RADIUS_M: Final = 0.077
HALF_AXLE_M: Final = 0.165
DURATION_S: Final = 0.065
"""From the first beam to the last: two thirds of a turn, at ten turns a second."""
TICKS: Final = 2000
"""One turn of a wheel."""


def read_breezy(path: Path, range_max_m: float = RANGE_MAX_M) -> LaserLog:
    """Reads a log.

    Raises:
        InputError: a line is damaged, or there is none.
    """
    scans: list[LoggedScan] = []
    before: list[float] | None = None
    for line in lines_of(path):
        ranges = line.numbers(FIRST, FIRST + BEAMS) / 1000.0
        ticks = line.numbers(2, 4).tolist()
        motion = None if before is None else _motion(ticks[0] - before[0], ticks[1] - before[1])
        scan = scan_of(
            np.where(ranges > 0.0, ranges, np.inf),
            -0.5 * SPAN_RAD,
            SPAN_RAD / (BEAMS - 1),
            min(range_max_m, RANGE_MAX_M),
        )
        scan = replace(scan, duration_s=DURATION_S)
        scans.append(LoggedScan(stamp_s=line.number(0) / 1e6, scan=scan, wheels=motion))
        before = ticks
    return log_of(path, scans)


def _motion(left: float, right: float) -> Planar:
    """The motion by the ticks of both wheels, half of its turn before it and half behind."""
    scale = 2.0 * pi * WHEEL_RADIUS_M / TICKS
    turn = scale * (left - right) / (2.0 * HALF_AXLE_M)
    half = Planar(0.0, 0.0, 0.5 * turn)
    return half @ Planar(0.5 * scale * (left + right), 0.0, 0.0) @ half
