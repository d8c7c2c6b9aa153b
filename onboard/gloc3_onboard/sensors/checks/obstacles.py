"""Obstacles from points: positions, distance by sector, and the nearest."""

from math import cos, pi, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.perception import LaserScan
from gloc3.messages.vehicle import NOT_MEASURED_M, OBSTACLE_SECTORS, ObstacleScan
from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import Mount, Tilt, points_of, ranges_of

BINS: Final = 180
"""Number of directions in which the nearest point is reported."""
APART_M: Final = 1.0
CLOSEST: Final = 8


def obstacles_of(
    scan: LaserScan, tilt: Tilt, mount: Mount, pose: Planar, motion: Planar, height_m: float
) -> ObstacleScan:
    """Obstacles hit by a valid scan, without the floor.

    Args:
        scan: the scan.
        tilt: tilt of the body.
        mount: mount of the scanner on it.
        pose: pose of the body: north, east, heading.
        motion: motion of the body during the scan.
        height_m: height of the body above the frame's origin.
    """
    points = points_of(scan, tilt, mount, motion).points_m
    ranges = ranges_of(scan)
    checked = np.flatnonzero(ranges > max(scan.range_min_m, 0.0))
    angles = np.asarray(mount.yaw_rad - scan.angle_min_rad - scan.angle_step_rad * checked, np.float64)
    return obstacles_at(points, angles, pose, height_m, scan.range_max_m)


def obstacles_at(points_m: Array, seen_rad: Array, pose: Planar, height_m: float, range_max_m: float) -> ObstacleScan:
    """Obstacles at points.

    Args:
        points_m: shape (n, 2), forward and right of the body.
        seen_rad: directions that were measured, clockwise from ahead; without a point, nothing is there.
        pose: pose of the body: north, east, heading.
        height_m: height of the body above the frame's origin.
        range_max_m: what is farther away is not measured.
    """
    distance = np.hypot(*points_m.T)
    bearing = np.arctan2(points_m[:, 1], points_m[:, 0])
    # By angle, then by distance: the first of each direction is the nearest.
    bins = np.floor(bearing * (BINS / (2.0 * pi))) % BINS
    order = np.lexsort((distance, bins))
    order = order[np.unique(bins[order], return_index=True)[1]]
    c, s = cos(pose.yaw_rad), sin(pose.yaw_rad)
    axes = np.array(((c, s), (-s, c)))
    reported = (points_m[order] @ axes + (pose.x_m, pose.y_m)).tolist()
    near = sorted(zip(distance[order].tolist(), reported, strict=True))
    sectors = np.full(OBSTACLE_SECTORS, NOT_MEASURED_M)
    sectors[_sector(seen_rad)] = range_max_m
    nearest = np.full(OBSTACLE_SECTORS, np.inf)
    np.minimum.at(nearest, _sector(bearing), distance)
    sectors = np.where(np.isfinite(nearest), nearest, sectors)
    return ObstacleScan(
        points_ne_m=[(north, east) for north, east in reported],
        height_m=height_m,
        sectors_m=[float(distance_m) for distance_m in sectors],
        range_max_m=range_max_m,
        closest_ne_m=_apart([(north, east) for _, (north, east) in near]),
    )


def _sector(bearing_rad: Array) -> NDArray[np.intp]:
    return np.floor(bearing_rad * (OBSTACLE_SECTORS / (2.0 * pi)) + 0.5).astype(np.intp) % OBSTACLE_SECTORS


def _apart(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The first points that are not near to one before them."""
    found: list[tuple[float, float]] = []
    for north, east in points:
        if all((north - n) ** 2 + (east - e) ** 2 > APART_M**2 for n, e in found):
            found.append((north, east))
            if len(found) == CLOSEST:
                break
    return found
