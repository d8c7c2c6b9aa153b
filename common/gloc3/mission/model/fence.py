"""The geofence in NED: how far inside it a point or a leg is, and where its walls are."""

from collections.abc import Iterator, Sequence
from math import hypot, inf, sqrt
from typing import Final

import msgspec

from gloc3.messages.frames import Vector3
from gloc3.mission.model.placement import Point

TOLERANCE_M: Final = 1e-3
"""Shortfall from a fence's margin that is tolerated, m."""
_SMALL_M: Final = 1e-9


class Area(msgspec.Struct, frozen=True, kw_only=True):
    """A horizontal area: a polygon, which may be concave, or a circle."""

    polygon_ne_m: tuple[Point, ...] = ()
    """Corners in metres north and east; the last is joined to the first."""
    center_ne_m: Point = (0.0, 0.0)
    """Centre of the circle, where there is no polygon."""
    radius_m: float = 0.0
    """Radius of the circle."""

    def clearance_m(self, north_m: float, east_m: float) -> float:
        """Distance to the edge: positive inside, negative outside."""
        if not self.polygon_ne_m:
            return self.radius_m - hypot(north_m - self.center_ne_m[0], east_m - self.center_ne_m[1])
        nearest, is_inside = inf, False  # every setpoint passes here: the sums of `_to_segment_m`, written out
        n0, e0 = self.polygon_ne_m[-1]
        for n1, e1 in self.polygon_ne_m:
            dn, de, n, e = n1 - n0, e1 - e0, north_m - n0, east_m - e0
            square, along = dn * dn + de * de, n * dn + e * de
            if along > 0.0 and square >= _SMALL_M:
                share = 1.0 if along >= square else along / square
                n -= share * dn
                e -= share * de
            gap = n * n + e * e
            if gap < nearest:
                nearest = gap
            if (e0 > east_m) != (e1 > east_m) and north_m < n0 + dn * (east_m - e0) / de:
                is_inside = not is_inside
            n0, e0 = n1, e1
        return sqrt(nearest) if is_inside else -sqrt(nearest)

    def leg_clearance_m(self, start: Point, end: Point) -> float:
        """The smallest clearance of any point of a straight leg."""
        lowest = min(self.clearance_m(*start), self.clearance_m(*end))
        if not self.polygon_ne_m:
            return lowest  # the farthest point from a centre is an end of the leg
        if lowest < 0.0:
            return lowest
        for edge in self.edges():
            if _cross(start, end, *edge):
                return min(0.0, lowest)
            lowest = min(lowest, *(_to_segment_m(*corner, *start, *end)[0] for corner in edge))
        return lowest

    def leg_distance_m(self, start: Point, end: Point) -> float:
        """How far the nearest point of a straight leg stays outside; zero or negative where it enters."""
        if not self.polygon_ne_m:
            return _to_segment_m(*self.center_ne_m, *start, *end)[0] - self.radius_m
        distance = min(-self.clearance_m(*start), -self.clearance_m(*end))
        for edge in self.edges():
            if _cross(start, end, *edge):
                return min(0.0, distance)
            distance = min(distance, *(_to_segment_m(*corner, *start, *end)[0] for corner in edge))
        return distance

    def overlaps(self, other: "Area") -> bool:
        """Whether a polygon and another area have places in common."""
        inner = other.polygon_ne_m[0] if other.polygon_ne_m else other.center_ne_m
        return self.clearance_m(*inner) > 0.0 or any(other.leg_distance_m(*edge) < _SMALL_M for edge in self.edges())

    def walls(self, north_m: float, east_m: float) -> Iterator[tuple[float, Point]]:
        """Distance in metres and direction (unit vector north, east) of the nearest point of each edge."""
        if not self.polygon_ne_m:
            n, e = north_m - self.center_ne_m[0], east_m - self.center_ne_m[1]
            length = hypot(n, e) or 1.0
            gap = self.radius_m - length
            sign = 1.0 if gap >= 0.0 else -1.0
            yield abs(gap), (sign * n / length, sign * e / length)
            return
        for (n0, e0), (n1, e1) in self.edges():
            distance, n, e = _to_segment_m(north_m, east_m, n0, e0, n1, e1)
            length = distance or 1.0
            yield distance, ((n - north_m) / length, (e - east_m) / length)

    def edges(self) -> Iterator[tuple[Point, Point]]:
        """The sides of the polygon."""
        corners = self.polygon_ne_m
        return zip(corners, corners[1:] + corners[:1], strict=True)


class Fence(msgspec.Struct, frozen=True, kw_only=True):
    """Allowed space of the vehicle: inside the area, outside all keep-out areas, below the ceiling."""

    area: Area | None = None
    """None where only height is limited."""
    keep_out: tuple[Area, ...] = ()
    ceiling_m: float | None = None
    """Greatest height above the origin of NED."""

    def clearance_m(self, position_ned_m: Vector3) -> float:
        """Distance to the nearest limit: positive where the vehicle may be, negative where not; infinite without any."""
        north, east, down = position_ned_m
        room_m = inf if self.area is None else self.area.clearance_m(north, east)
        for area in self.keep_out:
            room_m = min(room_m, -area.clearance_m(north, east))
        return room_m if self.ceiling_m is None else min(room_m, self.ceiling_m + down)

    def leg_clearance_m(self, start_ned_m: Vector3, end_ned_m: Vector3) -> float:
        """Smallest clearance on a straight leg."""
        start, end = start_ned_m[:2], end_ned_m[:2]
        gaps = [area.leg_distance_m(start, end) for area in self.keep_out]
        if self.area is not None:
            gaps.append(self.area.leg_clearance_m(start, end))
        if self.ceiling_m is not None:
            gaps.append(self.ceiling_m + min(start_ned_m[2], end_ned_m[2]))
        return min(gaps, default=inf)

    def walls(self, position_ned_m: Vector3) -> Iterator[tuple[float, Point]]:
        """Distance and direction of every edge, of the area and of the keep-out zones."""
        areas = self.keep_out if self.area is None else (self.area, *self.keep_out)
        for area in areas:
            yield from area.walls(position_ned_m[0], position_ned_m[1])


def polygon_problem(corners: Sequence[Point]) -> str:
    """Why these corners are no usable polygon; empty if they are one."""
    if len(set(corners)) < 3:
        return "a polygon has at least three different corners"
    sides = list(zip(corners, [*corners[1:], corners[0]], strict=True))
    count = len(sides)
    for i in range(count):
        for j in range(i + 2, count):
            if (j + 1) % count != i and _cross(*sides[i], *sides[j]):
                return f"the polygon crosses itself: side {i + 1} meets side {j + 1}"
    double_area = sum(a[0] * b[1] - b[0] * a[1] for a, b in sides)
    return "" if abs(double_area) > _SMALL_M else "the polygon has no area"


def _to_segment_m(n: float, e: float, n0: float, e0: float, n1: float, e1: float) -> tuple[float, float, float]:
    """Distance from a point to a segment, and the nearest point of it."""
    dn, de = n1 - n0, e1 - e0
    square = dn * dn + de * de
    along = 0.0 if square < _SMALL_M * _SMALL_M else min(1.0, max(0.0, ((n - n0) * dn + (e - e0) * de) / square))
    near_n, near_e = n0 + along * dn, e0 + along * de
    return hypot(n - near_n, e - near_e), near_n, near_e


def _side(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _within(a: Point, b: Point, c: Point) -> bool:
    return min(a[0], b[0]) <= c[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= c[1] <= max(a[1], b[1])


def _cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Whether two segments share a point."""
    abc, abd, cda, cdb = _side(a, b, c), _side(a, b, d), _side(c, d, a), _side(c, d, b)
    if ((abc > 0) != (abd > 0)) and ((cda > 0) != (cdb > 0)) and 0.0 not in (abc, abd, cda, cdb):
        return True
    return (
        (abc == 0 and _within(a, b, c))
        or (abd == 0 and _within(a, b, d))
        or (cda == 0 and _within(c, d, a))
        or (cdb == 0 and _within(c, d, b))
    )
