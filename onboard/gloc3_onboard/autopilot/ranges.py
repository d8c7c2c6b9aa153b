"""MAVLink's range messages as scans: OBSTACLE_DISTANCE, and several DISTANCE_SENSOR that look level.

MAVLink counts angles clockwise from ahead, a scan counter-clockwise; so the beams come in reversed order.
"""

import math
import struct
from collections.abc import Sequence
from typing import Final

from gloc3.mavlink.codec import MavlinkMessage
from gloc3.messages.perception import LaserScan

UNKNOWN_CM: Final = 0xFFFF
NORTH_ALIGNED: Final = (0, 1)
"""MAV_FRAME_GLOBAL, which an absent field means too, and MAV_FRAME_LOCAL_NED."""
LEVEL: Final = 8
"""MAV_SENSOR_ROTATION_NONE, YAW_45 ... YAW_315: so many directions."""
FAR_S: Final = 1.0
"""What has not been heard for so long is not known any more."""
_NOTHING: Final = math.inf
_NO_READING: Final = 0.0


def scan_of_obstacles(message: MavlinkMessage, yaw_rad: float | None) -> LaserScan:
    """OBSTACLE_DISTANCE as a scan ahead of the body; not valid where its directions are not known.

    Args:
        message: as it came.
        yaw_rad: the heading, clockwise from north; for messages whose angles count from north.
    """
    step_deg = message.increment_f or float(message.increment)
    offset_deg = message.angle_offset
    reason = ""
    if not math.isfinite(step_deg) or step_deg == 0.0 or not math.isfinite(offset_deg):
        reason, step_deg, offset_deg = "the scanner does not tell the directions of its beams", 1.0, 0.0
    if message.frame in NORTH_ALIGNED:
        if yaw_rad is None:
            reason = reason or "its directions count from north, and the heading is not known"
        else:
            offset_deg -= math.degrees(yaw_rad)
    count = min(len(message.distances), max(1, round(360.0 / abs(step_deg))))
    max_m = message.max_distance * 1e-2
    ranges = [_range_m(distance_cm, message.max_distance, max_m) for distance_cm in message.distances[:count]]
    return _scan("obstacles", offset_deg, step_deg, ranges, (message.min_distance * 1e-2, max_m), reason)


def _range_m(distance_cm: int, max_cm: int, max_m: float) -> float:
    if distance_cm == UNKNOWN_CM:
        return _NO_READING
    return _NOTHING if distance_cm >= max_cm else min(distance_cm * 1e-2, max_m)


def _scan(
    name: str,
    offset_deg: float,
    step_deg: float,
    ranges_m: Sequence[float],
    limits_m: tuple[float, float],
    reason: str = "",
) -> LaserScan:
    last_deg = offset_deg + (len(ranges_m) - 1) * step_deg
    is_clockwise = step_deg > 0.0
    ordered = [*reversed(ranges_m)] if is_clockwise else [*ranges_m]
    return LaserScan(
        scanner=name,
        angle_min_rad=math.radians(-last_deg if is_clockwise else -offset_deg),
        angle_step_rad=math.radians(abs(step_deg)),
        range_min_m=limits_m[0],
        range_max_m=limits_m[1],
        ranges_m=struct.pack(f"<{len(ordered)}f", *ordered),
        is_valid=not reason,
        reason=reason,
    )


class RangeRing:
    """Collects range finders that look level, at most one in each eighth of a turn, into a scan of eight beams."""

    def __init__(self) -> None:
        self._heard: dict[int, tuple[float, MavlinkMessage]] = {}

    def take(self, message: MavlinkMessage, now_s: float) -> LaserScan | None:
        """Takes a DISTANCE_SENSOR in; the scan with it, or None for one that does not look level."""
        if message.orientation >= LEVEL:
            return None
        self._heard[message.orientation] = (now_s, message)
        alive = {direction: heard for direction, (heard_s, heard) in self._heard.items() if now_s - heard_s < FAR_S}
        max_cm = max(heard.max_distance for heard in alive.values())
        ranges = [
            _range_m(alive[direction].current_distance, alive[direction].max_distance, max_cm * 1e-2)
            if direction in alive
            else _NO_READING
            for direction in range(LEVEL)
        ]
        least_m = min(heard.min_distance for heard in alive.values()) * 1e-2
        return _scan("ranges", 0.0, 360.0 / LEVEL, ranges, (least_m, max_cm * 1e-2))
