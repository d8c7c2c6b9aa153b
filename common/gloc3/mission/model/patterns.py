"""Path patterns: lines over an area, along a wall, through places; and departure.

A pattern says nothing that only one kind of vehicle can do: where its height and speed are left out, they are the
platform's `survey_height_m` and `survey_speed_m_s`. What flies it gets waypoints.
"""

from collections.abc import Iterable, Sequence
from math import atan2, cos, degrees, hypot, radians, sin, tan
from typing import Annotated, Final, Literal

import msgspec

from gloc3.errors import Refused
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.mission.model.arguments import (
    Arguments,
    Degrees,
    Dive,
    DriveOff,
    FollowWaypoints,
    FollowWaypointsOrder,
    Heading,
    Height,
    Latitude,
    Longitude,
    Metres,
    SetOff,
    Speed,
    TakeOff,
    speed_of,
)
from gloc3.mission.model.placement import Placement, Point, written_for
from gloc3.mission.model.waypoint_options import HoldTime, KeptAltitude, WallDistance, with_options
from gloc3.platform.limits import Limits

ARRIVE: Final = "arrive"
MAX_WAYPOINTS: Final = 10_000
Spacing = Annotated[float, msgspec.Meta(ge=0.1, le=10_000.0)]
LocalPoints = Annotated[tuple[tuple[Metres, Metres], ...], msgspec.Meta(min_length=1, max_length=1_000)]
GeoPoints = Annotated[tuple[tuple[Latitude, Longitude], ...], msgspec.Meta(min_length=1, max_length=1_000)]
LocalArea = Annotated[tuple[tuple[Metres, Metres], ...], msgspec.Meta(min_length=3, max_length=200)]
GeoArea = Annotated[tuple[tuple[Latitude, Longitude], ...], msgspec.Meta(min_length=3, max_length=200)]
_SMALL_M: Final = 1e-6
SURVEY_ACCEPTANCE_M: Final = 0.25
_SAME_M: Final = 1e-3
"""Places nearer to each other are one."""
_STARTS: Final = 20
"""So many lines are tried to begin with, where lines that follow each other must not be neighbours."""


class Depart(SetOff, frozen=True, kw_only=True):
    """Get ready to move, whatever the vehicle is: arm, and take off, dive or drive off to the platform's survey height."""

    def filled(self, limits: Limits | None) -> Arguments:
        """Departure that leads to the survey height."""
        height_m = limits.survey_height_m if limits is not None else 0.0
        if height_m is None:
            raise Refused("the platform's file states no limits.survey_height_m to depart to")
        if height_m == 0.0:
            return DriveOff()
        return TakeOff(height_m=height_m) if height_m > 0.0 else Dive(depth_m=-height_m)


class Arrive(Arguments, frozen=True, kw_only=True):
    """Return to home, end the motion there and disarm, for every class of vehicle.

    It stands for two actions, `return_home` and `land`, of which the first is named `NAME_return`.
    """

    moves = True


class AtSurveyHeight(Arguments, frozen=True, kw_only=True):
    """What every action takes that moves at one height."""

    moves = True

    height_m: Height | None = None
    """None: the platform's `survey_height_m`."""
    speed_m_s: Speed | None = None
    """None: the platform's `survey_speed_m_s`."""

    def filled(self, limits: Limits | None) -> Arguments:
        """With the platform's height and speed where the mission says none."""
        known = limits or Limits(height_min_m=-1.0, survey_height_m=0.0)
        height_m = self.height_m if self.height_m is not None else known.survey_height_m
        if height_m is None:
            raise Refused("height_m is missing, and the platform's file states no limits.survey_height_m")
        return msgspec.structs.replace(self, height_m=height_m, speed_m_s=self.speed_m_s or speed_of(limits))


class Pattern(AtSurveyHeight, frozen=True, kw_only=True):
    """What every pattern takes."""

    acceptance_m: Annotated[float, msgspec.Meta(gt=0.0, le=1_000.0)] | None = None
    """A waypoint counts as passed within this distance; None: the platform's `survey_acceptance_m`."""

    def filled(self, limits: Limits | None) -> Arguments:
        """With the platform's acceptance, too."""
        known = limits or Limits()
        acceptance_m = self.acceptance_m or known.survey_acceptance_m
        return msgspec.structs.replace(AtSurveyHeight.filled(self, limits), acceptance_m=acceptance_m)

    def order(self, placement: Placement) -> FollowWaypointsOrder:
        """The waypoints in NED."""
        return self.path(placement).order(placement)

    def path(self, placement: Placement) -> FollowWaypoints:
        """The same as waypoints, in the mission's frame.

        Raises:
            Refused: it cannot be laid; with the reason.
        """
        raise NotImplementedError

    def _path(
        self, ground: "_Ground", places: Iterable[tuple[float, float, float]], heading: Heading
    ) -> FollowWaypoints:
        """A path through positions `(north, east, height)`, all heights by the mission's reference."""
        points = tuple((*ground.written(north, east), height_m) for north, east, height_m in places)
        if len(points) > MAX_WAYPOINTS:
            raise Refused(f"it makes {len(points):,} waypoints; at most {MAX_WAYPOINTS:,} are possible")
        return self._through(points, is_geo=ground.is_geo, heading=heading)

    def _through(
        self, points: tuple[tuple[float, float, float], ...], *, is_geo: bool, heading: Heading
    ) -> FollowWaypoints:
        """Waypoints in the mission's frame, with the speed and the acceptance of the pattern."""
        return FollowWaypoints(
            waypoints=points if is_geo else None,
            waypoints_m=None if is_geo else points,
            heading=heading,
            speed_m_s=self.speed_m_s,
            acceptance_m=self.acceptance_m or SURVEY_ACCEPTANCE_M,
        )

    def _height_m(self, placement: Placement) -> float:
        if self.height_m is None:
            raise Refused("height_m is missing")
        return self.height_m


class Survey(Pattern, frozen=True, kw_only=True):
    """Parallel lines back and forth over an area (lawnmower); the first begins near the area's first corner."""

    example = "{area_m: [[0, 0], [40, 0], [40, 30], [0, 30]], spacing_m: 5}"
    one_of = (("area_m", "area"),)

    area_m: LocalArea | None = None
    """Corners `[x, y]`, in a local frame."""
    area: GeoArea | None = None
    """Corners `[latitude, longitude]`, in frame geo."""
    spacing_m: Spacing
    """From line to line."""
    lines_deg: Degrees | None = None
    """Direction of the lines, clockwise from north; None: along the area's longest side."""
    margin_m: Annotated[float, msgspec.Meta(ge=-1_000.0, le=1_000.0)] = 0.0
    """The lines end so far inside the area's edge; less than 0: outside."""
    is_crossed: bool = False
    """Flown a second time, across the first lines."""
    turn_m: Annotated[float, msgspec.Meta(ge=0.0, le=10_000.0)] | None = None
    """Least distance between successive lines; lines in between are flown later. None: room for the platform's
    `turn_radius_m` on both sides."""
    heading: Heading = "along"
    """Where the nose points."""
    altitude_m: KeptAltitude = None
    """Keep this height above the ground or the sea bed, by the downward range finder."""

    def filled(self, limits: Limits | None) -> Arguments:
        """With the room that the platform needs to turn, too."""
        turn_m = 2.0 * limits.turn_radius_m if limits is not None and limits.turn_radius_m else None
        is_reported = self.turn_m is not None or turn_m is None
        return super(Survey, self if is_reported else msgspec.structs.replace(self, turn_m=turn_m)).filled(limits)

    def path(self, placement: Placement) -> FollowWaypoints:
        """The lines, each by its two ends."""
        corners = written_for(placement, self.area_m, self.area, "area")
        assert corners is not None  # one of the two is given, and not that of the other kind of frame
        ground = _Ground(placement, corners[0])
        polygon = [ground.ne(corner) for corner in corners]
        bearing = radians(self.lines_deg) if self.lines_deg is not None else _longest_side(polygon)
        turn_m = self.turn_m or 0.0
        places = _lines(polygon, bearing, self.spacing_m, self.margin_m, polygon[0], turn_m)
        if self.is_crossed:
            last = (places or polygon)[-1]
            places += _lines(polygon, bearing + radians(90.0), self.spacing_m, self.margin_m, last, turn_m)
        if not places:
            raise Refused("no line fits into the area: its margin or spacing is too large")
        height_m = self._height_m(placement)
        path = self._path(ground, [(*place, height_m) for place in places], self.heading)
        return with_options(path, self)


class FollowWall(Pattern, frozen=True, kw_only=True):
    """Lines along a straight wall, one above the other, looking at it."""

    example = "{wall_m: [[0, 8], [30, 8]], side: right, standoff_m: 2, heights_m: [1, 5], spacing_m: 1}"
    one_of = (("wall_m", "wall"),)

    wall_m: tuple[tuple[Metres, Metres], tuple[Metres, Metres]] | None = None
    """The wall's two ends `[x, y]`, in a local frame."""
    wall: tuple[tuple[Latitude, Longitude], tuple[Latitude, Longitude]] | None = None
    """The wall's two ends `[latitude, longitude]`, in frame geo."""
    side: Literal["left", "right"]
    """The side of the wall on which the vehicle is, seen from its first end to its second."""
    standoff_m: Annotated[float, msgspec.Meta(gt=0.0, le=1_000.0)]
    """Distance from the wall."""
    heights_m: tuple[Height, Height] | None = None
    """The lowest and the highest line; None: one line at `height_m`."""
    spacing_m: Spacing | None = None
    """From line to line, at most."""
    overlap: Annotated[float, msgspec.Meta(ge=0.0, le=0.95)] | None = None
    """In place of `spacing_m`, with `view_deg`: the share of the picture that two lines have in common."""
    view_deg: Annotated[float, msgspec.Meta(gt=1.0, lt=180.0)] | None = None
    """The camera's angle of view from top to bottom."""
    is_upright: bool = False
    """Lines up and down instead, `spacing_m` from each other along the wall."""
    is_measured: bool = False
    """The distance is kept by the laser scanner, from 1.2 to 6 m."""

    def __post_init__(self) -> None:
        Arguments.__post_init__(self)
        if self.spacing_m is not None and self.overlap is not None:
            raise ValueError("give spacing_m, or overlap with view_deg, not both")
        if (self.overlap is None) != (self.view_deg is None):
            raise ValueError("overlap and view_deg go together")
        if self.heights_m is not None and self.heights_m[0] > self.heights_m[1]:
            raise ValueError("heights_m is [lowest, highest]")
        if self.heights_m is not None and self.heights_m[0] < self.heights_m[1] and self._spacing_m is None:
            raise ValueError("spacing_m is missing, or overlap with view_deg")
        if self.is_upright and (self.heights_m is None or self._spacing_m is None):
            raise ValueError("upright lines need heights_m, and spacing_m or overlap with view_deg")
        if self.is_measured and not 1.2 <= self.standoff_m <= 6.0:
            raise ValueError("a distance that is measured is from 1.2 to 6 m")

    @property
    def _spacing_m(self) -> float | None:
        if self.overlap is None or self.view_deg is None:
            return self.spacing_m
        return 2.0 * self.standoff_m * tan(radians(self.view_deg) / 2.0) * (1.0 - self.overlap)

    def filled(self, limits: Limits | None) -> Arguments:
        """With the platform's default height where no heights are given."""
        if self.heights_m is None:
            return super().filled(limits)
        return super(FollowWall, msgspec.structs.replace(self, height_m=self.heights_m[0])).filled(limits)

    def path(self, placement: Placement) -> FollowWaypoints:
        """The lines, each by its two ends, with the nose towards the wall."""
        ends = written_for(placement, self.wall_m, self.wall, "wall")
        assert ends is not None  # one of the two is given, and not that of the other kind of frame
        ground = _Ground(placement, ends[0])
        (n0, e0), (n1, e1) = ground.ne(ends[0]), ground.ne(ends[1])
        length_m = hypot(n1 - n0, e1 - e0)
        if length_m < _SMALL_M:
            raise Refused("both ends of the wall are one place")
        sign = 1.0 if self.side == "right" else -1.0
        away = (-sign * (e1 - e0) / length_m, sign * (n1 - n0) / length_m)
        first = (n0 + self.standoff_m * away[0], e0 + self.standoff_m * away[1])
        last = (n1 + self.standoff_m * away[0], e1 + self.standoff_m * away[1])
        low_m, high_m = self.heights_m or (self._height_m(placement),) * 2
        spacing_m = self._spacing_m
        if self.is_upright and spacing_m is not None:
            shares = _steps(length_m, spacing_m)
            feet = [_between(first, last, share) for share in shares]
            places = _to_and_fro([((*foot, low_m), (*foot, high_m)) for foot in feet])
        else:
            shares = _steps(high_m - low_m, spacing_m or 1.0)
            heights = [low_m + share * (high_m - low_m) for share in shares]
            places = _to_and_fro([((*first, height_m), (*last, height_m)) for height_m in heights])
        path = self._path(ground, places, degrees(atan2(-away[1], -away[0])))
        measured: WallDistance | None = self.standoff_m if self.is_measured else None
        return msgspec.structs.replace(path, wall_distance_m=measured)


class Transit(Pattern, frozen=True, kw_only=True):
    """Go through places, at the platform's survey height."""

    example = "{to_m: [[40, 0], [40, 30]]}"
    one_of = (("to_m", "to"),)

    to_m: LocalPoints | None = None
    """Places `[x, y]`, in a local frame."""
    to: GeoPoints | None = None
    """Places `[latitude, longitude]`, in frame geo."""
    heading: Heading = "along"
    """Where the nose points."""
    hold_s: HoldTime = 0.0
    """Time to stay at each position."""
    altitude_m: KeptAltitude = None
    """Keep this height above the ground or the sea bed, by the downward range finder."""

    def path(self, placement: Placement) -> FollowWaypoints:
        """The places, with a height."""
        places = written_for(placement, self.to_m, self.to, "to")
        assert places is not None  # one of the two is given, and not that of the other kind of frame
        height_m = self._height_m(placement)
        points = tuple((*place, height_m) for place in places)
        path = self._through(points, is_geo=placement.is_geo, heading=self.heading)
        return with_options(path, self)


class _Ground:
    """Metres north and east for horizontal positions of a mission, and back."""

    def __init__(self, placement: Placement, first: Point) -> None:
        self.is_geo: Final = placement.is_geo
        if self.is_geo:
            self._plane = TangentPlane(GeoPoint(first[0], first[1], 0.0))
        else:
            origin, unit = placement.ned_from((0.0, 0.0, 0.0)), placement.ned_from((1.0, 0.0, 0.0))
            self._cosine, self._sine = unit[0] - origin[0], unit[1] - origin[1]

    def ne(self, place: Point) -> Point:
        """Metres north and east, of the first place or of the frame's origin; x points along the frame's bearing."""
        if self.is_geo:
            north, east, _ = self._plane.ned_from_geo(*place, 0.0)
            return north, east
        x, y = place
        return x * self._cosine + y * self._sine, x * self._sine - y * self._cosine

    def written(self, north_m: float, east_m: float) -> Point:
        """As the mission writes it."""
        if self.is_geo:
            place = self._plane.geo_from_ned((north_m, east_m, 0.0))
            return place.latitude_deg, place.longitude_deg
        return (
            north_m * self._cosine + east_m * self._sine,
            north_m * self._sine - east_m * self._cosine,
        )


def _longest_side(polygon: Sequence[Point]) -> float:
    """Bearing of the longest side, in radians."""
    sides = [(hypot(b[0] - a[0], b[1] - a[1]), a, b) for a, b in zip(polygon, [*polygon[1:], polygon[0]], strict=True)]
    _, a, b = max(sides, key=lambda side: side[0])
    return atan2(b[1] - a[1], b[0] - a[0])


def _lines(
    polygon: Sequence[Point], bearing_rad: float, spacing_m: float, margin_m: float, near: Point, turn_m: float = 0.0
) -> list[Point]:
    """Both ends of each line over a polygon, to and fro; the first is the end that is nearest to a place.

    Where a line leaves the polygon and enters it again, as in a bay, it has two ends there more. Lines that follow each
    other are `turn_m` from each other or more, where that can be.
    """
    cosine, sine = cos(bearing_rad), sin(bearing_rad)

    def turned(point: Point) -> Point:
        return point[0] * cosine + point[1] * sine, -point[0] * sine + point[1] * cosine

    corners = [turned(point) for point in polygon]
    edges = list(zip(corners, [*corners[1:], corners[0]], strict=True))
    low, high = min(c for _, c in corners) + margin_m, max(c for _, c in corners) - margin_m
    if high < low:
        return []
    along = turned(near)
    is_low_first = abs(along[1] - low) <= abs(along[1] - high)
    lines: list[list[tuple[Point, Point]]] = []
    inside_m = 1e-6 * max(1.0, high - low)
    for share in _steps(high - low, spacing_m):
        across = low + share * (high - low) if is_low_first else high - share * (high - low)
        at = min(max(across, low + inside_m), high - inside_m)  # a line along an edge is inside, by a hair
        cuts = sorted(
            a[0] + (at - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) for a, b in edges if (a[1] > at) != (b[1] > at)
        )
        pieces = [(begin + margin_m, end - margin_m) for begin, end in zip(cuts[::2], cuts[1::2], strict=False)]
        line = [((begin, across), (end, across)) for begin, end in pieces if end - begin >= 0.0]
        lines += [line] if line else []
    if not lines:
        return []
    lines = [lines[index] for index in _apart([line[0][0][1] for line in lines], turn_m)]
    begin, end = lines[0][0][0][0], lines[0][-1][1][0]
    is_forward = abs(along[0] - begin) <= abs(along[0] - end)
    places: list[Point] = []
    for line in lines:
        ends = [point for piece in line for point in piece]
        places += ends if is_forward else ends[::-1]
        is_forward = not is_forward
    ends = [(a * cosine - c * sine, a * sine + c * cosine) for a, c in places]
    return [
        b
        for index, b in enumerate(ends)
        if index == 0 or hypot(b[0] - ends[index - 1][0], b[1] - ends[index - 1][1]) > _SAME_M
    ]


def _apart(places_m: Sequence[float], least_m: float) -> list[int]:
    """An order in which each place is `least_m` or more from the one before, the nearest such first; as they are, if none."""
    plain = list(range(len(places_m)))
    if least_m <= 0.0:
        return plain
    for first in plain[:_STARTS]:
        order, left = [first], set(plain) - {first}
        while left:
            here = places_m[order[-1]]
            far = [index for index in left if abs(places_m[index] - here) >= least_m - _SAME_M]
            if not far:
                break
            order.append(min(far, key=lambda index: (abs(places_m[index] - here), index)))
            left.remove(order[-1])
        else:
            return order
    return plain


def _steps(length_m: float, spacing_m: float) -> list[float]:
    """Shares of a length, both ends among them, no farther from each other than the spacing."""
    count = 0 if length_m < _SMALL_M else max(1, -int(-(length_m - _SMALL_M) // spacing_m))
    if count > MAX_WAYPOINTS:
        raise Refused(f"spacing_m {spacing_m:g} makes more than {MAX_WAYPOINTS:,} lines")
    return [index / count for index in range(count + 1)] if count else [0.0]


def _between(a: Point, b: Point, share: float) -> Point:
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


def _to_and_fro(
    lines: Sequence[tuple[tuple[float, float, float], tuple[float, float, float]]],
) -> list[tuple[float, float, float]]:
    """The ends of lines, every second one backwards."""
    return [place for index, line in enumerate(lines) for place in (line if index % 2 == 0 else line[::-1])]


def height_is_known(placement: Placement, arguments: Arguments) -> bool:
    """Whether the platform's survey height, which counts from home, can be used as a height of the mission."""
    return not (placement.counts_from_sea and isinstance(arguments, AtSurveyHeight) and arguments.height_m is None)
