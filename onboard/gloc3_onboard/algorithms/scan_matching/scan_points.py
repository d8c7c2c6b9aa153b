"""Preprocessing of scans and point clouds: range checks, deskewing, leveling and removal of the floor."""

from math import cos, sin
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import Vector3
from gloc3.messages.perception import LaserScan, PointCloud
from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar

FEWEST_BEAMS: Final = 20
FLOOR_M: Final = 0.15
"""What is lower than this above the floor, and a share of its distance, is taken for the floor."""
FLOOR_SHARE: Final = 0.02
OLDEST_S: Final = 1.0
"""Greatest age of a point of a cloud: a turn of the slowest scanner takes 0.2 s."""


class Tilt(NamedTuple):
    """Roll, pitch and height of the body."""

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    height_m: float | None = None
    """Height of the body above the floor; None if unknown: nothing then counts as floor."""


class Mount(NamedTuple):
    """Mounting pose of the scanner on the body."""

    position_frd_m: Vector3 = (0.0, 0.0, 0.0)
    yaw_rad: float = 0.0
    """Direction of the middle beam, clockwise seen from above, rad."""


class Twist(NamedTuple):
    """Velocity and turn rate of the body, on its axes at the time of a cloud."""

    velocity_frd_m_s: Vector3 = (0.0, 0.0, 0.0)
    rate_frd_rad_s: Vector3 = (0.0, 0.0, 0.0)


class ScanPoints(NamedTuple):
    """Hit points of a scan, in the level plane of the body: x forward, y right."""

    points_m: Array
    """In the order of the beams; shape (n, 2)."""
    beams: NDArray[np.intp]
    """Index of each point's beam."""
    ranges_m: Array
    """Distance of each point from the scanner."""
    step_rad: float
    """Angle from beam to beam."""
    size: int
    """How many beams the scan has."""
    below_m: Array
    """How far each point is below the body."""


class LevelPoints(NamedTuple):
    """The points of a cloud on the level axes of the body: forward, right and down."""

    points_m: Array
    """Shape (n, 3)."""
    is_floor: NDArray[np.bool_]
    """Which are too near to the floor to be anything else."""
    origin_m: Array
    """Where they were seen from, shape (3,)."""


def ranges_of(scan: LaserScan) -> Array:
    """The ranges of a scan as numbers, in metres."""
    return np.frombuffer(scan.ranges_m, "<f4").astype(np.float64)


def _nothing_m(scan: LaserScan) -> float:
    """Range from which on nothing was hit: slightly below the maximum, which 32 bits may round down."""
    return scan.range_max_m * (1.0 - 1e-6)


def fault_of(scan: LaserScan) -> str:
    """Why a scan cannot be used; empty if it can."""
    if not scan.is_valid:
        return scan.reason or "the scanner says that its scan is not valid"
    if len(scan.ranges_m) % 4 or len(scan.ranges_m) < 4 * FEWEST_BEAMS:
        return f"the scan has {len(scan.ranges_m)} bytes, which is not a range of 4 for each of {FEWEST_BEAMS} beams or more"
    if not (np.isfinite(scan.angle_min_rad) and np.isfinite(scan.angle_step_rad) and scan.angle_step_rad != 0.0):
        return "the scan does not say where its beams look"
    ranges = ranges_of(scan)
    is_hit = (ranges > max(scan.range_min_m, 0.0)) & (ranges < _nothing_m(scan))
    if np.count_nonzero(is_hit) >= FEWEST_BEAMS:
        return ""
    if not np.any(np.isfinite(ranges)):
        return "no range of the scan is a number"
    if not np.any(ranges > 0.0):
        return "all ranges of the scan are zero"
    if np.all(ranges[np.isfinite(ranges)] >= _nothing_m(scan)):
        return "nothing is in reach of the scanner"
    return f"only {np.count_nonzero(is_hit)} beams of the scan have hit anything"


def points_of(scan: LaserScan, tilt: Tilt, mount: Mount, motion: Planar) -> ScanPoints:
    """The points of a usable scan, as seen from its end, without the floor.

    Args:
        scan: it.
        tilt: how the body stood.
        mount: where the scanner sits.
        motion: the motion of the body during the scan, by which earlier beams are moved back.
    """
    ranges = ranges_of(scan)
    size = len(ranges)
    is_hit = (ranges > max(scan.range_min_m, 0.0)) & (ranges < _nothing_m(scan))
    beams = np.flatnonzero(is_hit)
    ranges = ranges[beams]
    # Angles of the scan are counter-clockwise, those of the body clockwise.
    angles = mount.yaw_rad - (scan.angle_min_rad + scan.angle_step_rad * beams)
    x, y, z = mount.position_frd_m
    forward, right = ranges * np.cos(angles) + x, ranges * np.sin(angles) + y
    # Deskew: each beam is moved by the share of the motion that came after it.
    if motion.distance_m > 0.0 or motion.yaw_rad:
        forward, right = _moved_back(forward, right, 1.0 - beams / (size - 1), motion)
    sr, cr, sp, cp = sin(tilt.roll_rad), cos(tilt.roll_rad), sin(tilt.pitch_rad), cos(tilt.pitch_rad)
    # Level: R_pitch R_roll of each point, the vertical left out; hits near the floor are dropped.
    level = np.column_stack((cp * forward + sp * (sr * right + cr * z), cr * right - sr * z))
    below = cp * (sr * right + cr * z) - sp * forward
    if tilt.height_m is not None:
        is_kept = tilt.height_m - below > FLOOR_M + FLOOR_SHARE * ranges
        level, beams, ranges, below = level[is_kept], beams[is_kept], ranges[is_kept], below[is_kept]
    return ScanPoints(level, beams, ranges, abs(scan.angle_step_rad), size, below)


def cloud_fault(cloud: PointCloud) -> str:
    """Why a cloud cannot be used; empty if it can. One without points can: so it is in the open."""
    if not cloud.is_valid:
        return cloud.reason or "the sensor says that its points are not valid"
    if len(cloud.data) % 12:
        return f"{len(cloud.data)} bytes are not points of 12 bytes"
    if not cloud.ages_s:
        return ""
    if 3 * len(cloud.ages_s) != len(cloud.data):
        return f"{len(cloud.ages_s)} bytes are not an age of 4 bytes for each of {len(cloud.data) // 12} points"
    ages = np.frombuffer(cloud.ages_s, "<f4")
    return "" if ((ages >= 0.0) & (ages <= OLDEST_S)).all() else f"an age of a point is not from 0 to {OLDEST_S:g} s"


def level_points(cloud: PointCloud, tilt: Tilt, twist: Twist) -> LevelPoints:
    """The points of a usable cloud that are numbers, as seen at its time.

    Args:
        cloud: it.
        tilt: how the body stood.
        twist: how it moved, by which earlier points are moved back.
    """
    points = np.frombuffer(cloud.data, "<f4").astype(np.float64).reshape(-1, 3)
    if cloud.ages_s:
        points = _deskewed(points, np.frombuffer(cloud.ages_s, "<f4").astype(np.float64)[:, None], twist)
    points = points[np.isfinite(points).all(axis=1)]
    sr, cr, sp, cp = sin(tilt.roll_rad), cos(tilt.roll_rad), sin(tilt.pitch_rad), cos(tilt.pitch_rad)
    level_from_frd = np.array(((cp, sp * sr, sp * cr), (0.0, cr, -sr), (-sp, cp * sr, cp * cr)))
    points, origin = points @ level_from_frd.T, level_from_frd @ np.array(cloud.origin_frd_m)
    is_floor = np.zeros(len(points), np.bool_)
    if tilt.height_m is not None:
        away_m = np.linalg.norm(points - origin, axis=1)
        is_floor = tilt.height_m - points[:, 2] <= FLOOR_M + FLOOR_SHARE * away_m
    return LevelPoints(points, is_floor, origin)


def _deskewed(points: Array, ages_s: Array, twist: Twist) -> Array:
    """Points on the axes of a body that has moved evenly since they were seen, (n, 3); ages (n, 1). Turns by Rodrigues."""
    rate = np.array(twist.rate_frd_rad_s)
    rate_rad_s = float(np.linalg.norm(rate))
    if rate_rad_s > 0.0:
        axis, angle = -rate / rate_rad_s, rate_rad_s * ages_s
        along = (points @ axis)[:, None] * axis
        points = along + np.cos(angle) * (points - along) + np.sin(angle) * np.cross(axis, points)
    moved: Array = points - ages_s * np.array(twist.velocity_frd_m_s)
    return moved


def _moved_back(forward: Array, right: Array, shares: Array, motion: Planar) -> tuple[Array, Array]:
    """Points seen at a share of the motion before its end, on the axes of its end."""
    turn = -shares * motion.yaw_rad
    c, s = np.cos(turn), np.sin(turn)
    ahead, aside = forward - shares * motion.x_m, right - shares * motion.y_m
    return c * ahead - s * aside, s * ahead + c * aside
