"""Checks that a scanner's turn is usable: a number for each beam, and something in it."""

import math
from typing import TYPE_CHECKING, Final

import msgspec

from gloc3.messages.perception import LaserScan

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

LEAST_BEAMS: Final = 2
NO_READING: Final = 0.0
"""Below every scanner's least range: such a beam says nothing, neither near nor far."""
LEAST_PAIRS: Final = 60
NEXT_M: Final = 0.1
NEXT_SHARE: Final = 0.03
"""Next beams that differ by less than that, and by this share of the range, have hit the same thing."""
LEAST_CLOSE: Final = 0.15
"""Smallest share of close neighbouring beams in a plausible scan."""


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
    if _is_scattered(np.where(has_reading & (ranges < scan.range_max_m), ranges, np.nan)):
        return msgspec.structs.replace(scan, is_valid=False, reason="its beams are unrelated to each other")
    if has_reading.all():
        return scan
    clean = np.where(has_reading, ranges, np.float32(NO_READING)).astype("<f4")
    return msgspec.structs.replace(scan, ranges_m=clean.tobytes())


def _is_scattered(ranges: "NDArray[np.floating]") -> bool:
    """Whether almost all neighbouring beams hit far apart points, which no real place causes."""
    import numpy as np

    near, far = ranges[:-1], ranges[1:]
    is_pair = np.isfinite(near + far)
    if np.count_nonzero(is_pair) < LEAST_PAIRS:
        return False
    near, far = near[is_pair], far[is_pair]
    is_close = np.abs(far - near) < NEXT_M + NEXT_SHARE * np.minimum(near, far)
    return bool(np.mean(is_close) < LEAST_CLOSE)


def _shape_problem(scan: LaserScan) -> str:
    if not scan.is_valid:
        return scan.reason or "the scanner reports it"
    count, rest = divmod(len(scan.ranges_m), 4)
    if rest or count < LEAST_BEAMS:
        return f"torn: {len(scan.ranges_m)} bytes are not whole beams"
    angles = (scan.angle_min_rad, scan.angle_step_rad)
    if not all(map(math.isfinite, angles)) or scan.angle_step_rad == 0.0:
        return "the directions of its beams are not known"
    if not 0.0 <= scan.range_min_m < scan.range_max_m:
        return f"its ranges from {scan.range_min_m:g} to {scan.range_max_m:g} m are impossible"
    return ""
