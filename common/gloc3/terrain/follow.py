"""Paths that keep a height above the ground: places between waypoints wherever the ground is not as straight as the path."""

from collections.abc import Sequence
from itertools import pairwise
from math import ceil, hypot
from typing import Final

import numpy as np

from gloc3.errors import Refused
from gloc3.messages.frames import GeoPoint, TangentPlane, Vector3
from gloc3.terrain.ground_level import GroundLevel

FOLLOW_TOLERANCE_M: Final = 2.0
"""A path departs from its height above the tiles' ground by no more than this, vertically."""
STEP_M: Final = 5.0
"""Distance at which the ground between two waypoints is read: a sixth of the finest tiles' spacing."""
LONGEST_M: Final = 100_000.0
"""A longer straight path is refused."""


def follow_ground(
    waypoints: Sequence[Vector3], plane: TangentPlane, ground: GroundLevel
) -> tuple[tuple[Vector3, ...], tuple[int, ...]]:
    """The path through waypoints whose heights are above the ground.

    Between two waypoints the height above the ground changes evenly.

    Args:
        waypoints: latitude and longitude in degrees, height above the ground in metres.
        plane: in which the path is.
        ground: below.

    Returns:
        The path in NED, and the indices of its places that are not waypoints.

    Raises:
        Refused: the height of the ground is not known somewhere, or two waypoints are too far apart.
    """
    path: list[Vector3] = []
    between: list[int] = []
    for latitude, longitude, height_m in waypoints[:1]:
        path.append(plane.ned_from_geo(latitude, longitude, ground.altitude_m(latitude, longitude) + height_m))
    for number, (one, other) in enumerate(pairwise(waypoints), start=1):
        places = _leg(one, other, plane, ground, number)
        between += range(len(path), len(path) + len(places) - 1)
        path += places
    return tuple(path), tuple(between)


def _leg(one: Vector3, other: Vector3, plane: TangentPlane, ground: GroundLevel, number: int) -> list[Vector3]:
    """The places after the first waypoint, up to the second."""
    start, end = plane.ned_from_geo(*one[:2], 0.0), plane.ned_from_geo(*other[:2], 0.0)
    length_m = hypot(end[0] - start[0], end[1] - start[1])
    if length_m > LONGEST_M:
        raise Refused(
            f"waypoints {number} and {number + 1} are {length_m / 1e3:,.0f} km apart; "
            f"above the ground at most {LONGEST_M / 1e3:.0f} km are possible"
        )
    shares = np.linspace(0.0, 1.0, max(1, ceil(length_m / STEP_M)) + 1)
    rows = np.outer(1.0 - shares, start) + np.outer(shares, end)
    geo = [GeoPoint(*one), *(plane.geo_from_ned((n, e, d)) for n, e, d in rows[1:-1].tolist()), GeoPoint(*other)]
    altitudes_m = ground.terrain.altitudes_m(
        np.array([place[0] for place in geo]), np.array([place[1] for place in geo])
    )
    for place in (place for place, altitude_m in zip(geo, altitudes_m, strict=True) if np.isnan(altitude_m)):
        raise Refused(ground.terrain.gap(place.latitude_deg, place.longitude_deg))
    wanted_m = altitudes_m + ground.offset_m + one[2] + shares * (other[2] - one[2])
    points = [plane.ned_from_geo(*place[:2], height) for place, height in zip(geo, wanted_m.tolist(), strict=True)]
    down_m = np.array([point[2] for point in points])
    return [points[index] for index in _needed(down_m)[1:]]


def _needed(values: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> list[int]:
    """Indices of evenly spaced values that straight lines must pass to come near all others (Douglas and Peucker, 1973)."""
    kept, waiting = {0, len(values) - 1}, [(0, len(values) - 1)]
    while waiting:
        begin, end = waiting.pop()
        if end - begin < 2:
            continue
        line = np.linspace(values[begin], values[end], end - begin + 1)
        errors = np.abs(values[begin : end + 1] - line)
        worst = int(errors.argmax())
        if errors[worst] > FOLLOW_TOLERANCE_M:
            kept.add(begin + worst)
            waiting += [(begin, begin + worst), (begin + worst, end)]
    return sorted(kept)
