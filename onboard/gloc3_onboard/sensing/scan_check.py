"""Whether a scanner's turn can be used: a number for each beam, and something in it."""

import math
from typing import Final

import msgspec

from gloc3.perception import LaserScan

LEAST_BEAMS: Final = 2
NO_READING: Final = 0.0
"""Below every scanner's least range: such a beam says nothing, neither near nor far."""


def checked_scan(scan: LaserScan) -> LaserScan:
    """The scan with beams that are no numbers, or negative, as *no reading*; marked where it cannot be used.

    Nothing seen in any direction is a valid scan: so it is in the open. Whoever moves by it has to see that.
    """
    problem = _shape_problem(scan)
    if problem:
        return msgspec.structs.replace(scan, is_valid=False, reason=problem)
    import numpy as np

    ranges = np.frombuffer(scan.ranges_m, "<f4")
    is_number = np.isfinite(ranges) | np.isposinf(ranges)
    has_reading = is_number & (ranges >= scan.range_min_m)
    if not has_reading.any():
        what = "no beam is a number" if not is_number.any() else f"no beam reads more than {scan.range_min_m:g} m"
        return msgspec.structs.replace(scan, is_valid=False, reason=what)
    if has_reading.all():
        return scan
    clean = np.where(has_reading, ranges, np.float32(NO_READING)).astype("<f4")
    return msgspec.structs.replace(scan, ranges_m=clean.tobytes())


def _shape_problem(scan: LaserScan) -> str:
    if not scan.is_valid:
        return scan.reason or "the scanner says so"
    count, rest = divmod(len(scan.ranges_m), 4)
    if rest or count < LEAST_BEAMS:
        return f"torn: {len(scan.ranges_m)} bytes are no beams"
    angles = (scan.angle_min_rad, scan.angle_step_rad)
    if not all(map(math.isfinite, angles)) or scan.angle_step_rad == 0.0:
        return "the directions of its beams are not known"
    if not 0.0 <= scan.range_min_m < scan.range_max_m:
        return f"its ranges from {scan.range_min_m:g} to {scan.range_max_m:g} m cannot be"
    return ""
