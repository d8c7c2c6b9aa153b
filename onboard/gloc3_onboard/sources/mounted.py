"""How a scanner sits on its vehicle: turned about its axis, or upside down."""

import math

import msgspec

from gloc3.messages.perception import LaserScan
from gloc3_onboard.sources.url import SourceUrl


def mounted_scan(scan: LaserScan, url: SourceUrl) -> LaserScan:
    """The scan with x forward, for a scanner whose zero looks `yaw_deg` to the left, or that hangs (`is_flipped=1`)."""
    yaw_rad = math.radians(url.number("yaw_deg", 0.0))
    if url.number("is_flipped", 0.0):
        import numpy as np

        ranges = np.frombuffer(scan.ranges_m, "<f4")
        last_rad = scan.angle_min_rad + (len(ranges) - 1) * scan.angle_step_rad
        scan = msgspec.structs.replace(scan, angle_min_rad=-last_rad, ranges_m=ranges[::-1].tobytes())
    return msgspec.structs.replace(scan, angle_min_rad=scan.angle_min_rad + yaw_rad) if yaw_rad else scan
