"""Places that a mission's text names and that the map can edit: waypoints, corners, centres, single places."""

from collections.abc import Callable, Iterator
from enum import StrEnum
from functools import lru_cache
from math import hypot
from typing import Any, Final, NamedTuple

from gloc3.documents.document import Where, parse
from gloc3.errors import InputError, Refused
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.messages.motion import SiteSummary
from gloc3.mission.reading.mission_site import MissionSite
from gloc3.mission.reading.reader import inspect_mission
from gloc3.terrain import Terrain
from gloc3_groundstation.mapping.requested import references

Point = tuple[float, float]


class HandleKind(StrEnum):
    """What a place is for."""

    WAYPOINT = "waypoint"
    """It has a height."""
    PLACE = "place"
    """It has none, such as a place to land at."""
    CORNER = "corner"
    """Of an area that is flown over, or of a wall."""
    FENCE = "fence corner"
    RALLY = "rally point"
    """It has a height."""
    CENTER = "center of the fence"


_LISTS: Final = {
    "waypoints": HandleKind.WAYPOINT,
    "to": HandleKind.PLACE,
    "area": HandleKind.CORNER,
    "wall": HandleKind.CORNER,
    "polygon": HandleKind.FENCE,
}
_SINGLES: Final = {"position": HandleKind.WAYPOINT, "at": HandleKind.PLACE, "center": HandleKind.CENTER}
LEAST: Final = {"waypoints": 1, "to": 1, "area": 3, "wall": 2, "polygon": 3}
"""Places that a list has at least."""


class Handle(NamedTuple):
    """One place in the text."""

    where: Where
    """Of the list of its numbers."""
    kind: HandleKind
    label: str
    """`waypoint 3 of fly.way`."""
    position_ne_m: Point
    """North and east of the origin of the vehicle's frame."""
    height_m: float | None = None
    """As written; None for a place without one."""
    siblings: int = 1
    """Places in its list."""
    line: int = 0
    """Of the text, from 1."""

    @property
    def is_in_list(self) -> bool:
        """Whether it is one of several."""
        return isinstance(self.where[-1], int)

    @property
    def list_where(self) -> Where:
        """Of the list that it is in."""
        return self.where[:-1]

    @property
    def key(self) -> str:
        """The argument or part of the fence, without the ending of local frames."""
        name = self.where[-2] if self.is_in_list else self.where[-1]
        return str(name).removesuffix("_m")

    @property
    def least(self) -> int:
        """Places that its list has at least."""
        return LEAST.get(self.key, 1)

    @property
    def is_closed(self) -> bool:
        """Whether the last of its list is joined to the first."""
        return self.key in ("area", "polygon")


class MissionPlaces(NamedTuple):
    """All places of a mission's text, in the order of the text; or the rally points of a vehicle."""

    handles: tuple[Handle, ...]
    is_geo: bool
    """Whether positions are latitudes and longitudes."""
    written: Callable[[Point], Point]
    """The two numbers of a place, as the mission's frame writes them."""

    def find(self, where: Where | None) -> Handle | None:
        """The handle at a path."""
        return next((one for one in self.handles if one.where == where), None)

    def neighbours(self, handle: Handle) -> list[Handle]:
        """The places before and after one in its list, as they are joined."""
        if not handle.is_in_list or handle.kind is HandleKind.RALLY:
            return []
        index = handle.where[-1]
        assert isinstance(index, int)
        near = {index - 1, index + 1}
        if handle.is_closed:
            near = {step % handle.siblings for step in near}
        return [one for step in sorted(near) if (one := self.find((*handle.list_where, step))) is not None]

    def nearest(self, place: Point, within_m: float) -> Handle | None:
        """The handle nearest to a place; None without one within a distance. Waypoints go before corners."""
        found = [(self._away_m(one, place), one) for one in self.handles]
        near = [(away_m, one) for away_m, one in found if away_m <= within_m]
        return min(near, key=lambda each: (each[0], each[1].kind), default=(0.0, None))[1]

    @staticmethod
    def _away_m(handle: Handle, place: Point) -> float:
        return hypot(handle.position_ne_m[0] - place[0], handle.position_ne_m[1] - place[1])


@lru_cache(maxsize=8)
def places_of(text: str, carried: str, site: SiteSummary | None, terrain: Terrain | None) -> MissionPlaces | None:
    """The places of a mission; None where it is not on this map, or cannot be read at all.

    Args:
        text: as it is edited.
        carried: the same with the libraries that it includes.
        site: the vehicle's frame, and home; None where they are unknown.
        terrain: heights of the ground; None without tiles.
    """
    surroundings = references(site, terrain)
    try:
        found = inspect_mission(carried, "mission", surroundings).site
        document = parse(text, "mission")
    except InputError:
        return None
    if found is None or not isinstance(document.value, dict):
        return None
    handles = tuple(one._replace(line=document.node(one.where).line) for one in _handles(document.value, found))
    return MissionPlaces(handles, found.placement.is_geo, _inverse(found))


def _inverse(site: MissionSite) -> Callable[[Point], Point]:
    """Converts metres north and east to the mission's own numbers."""
    if site.placement.is_geo:
        plane = TangentPlane(site.origin or GeoPoint(0.0, 0.0, 0.0))

        def to_geo(place: Point) -> Point:
            found = plane.geo_from_ned((*place, 0.0))
            return found.latitude_deg, found.longitude_deg

        return to_geo
    origin, unit = site.level.ned_from((0.0, 0.0, 0.0)), site.level.ned_from((1.0, 0.0, 0.0))
    cosine, sine = unit[0] - origin[0], unit[1] - origin[1]

    def to_local(place: Point) -> Point:
        north, east = place[0] - origin[0], place[1] - origin[1]
        return north * cosine + east * sine, north * sine - east * cosine

    return to_local


def _handles(value: dict[str, Any], site: MissionSite) -> Iterator[Handle]:
    for group in ("tasks", "contingencies"):
        for task, content in _entries(value.get(group)):
            for action, described in _entries(content, "actions"):
                for capability, arguments in _entries(described):
                    where = (group, task, "actions", action, capability)
                    yield from _in(arguments, where, f"{task}.{action}", site)
    fence = value.get("geofence")
    yield from _in(fence, ("geofence",), "the fence", site)
    areas = fence.get("keep_out") if isinstance(fence, dict) else None
    for index, area in enumerate(areas if isinstance(areas, list) else ()):
        yield from _in(area, ("geofence", "keep_out", index), f"keep-out area {index + 1}", site)


def _in(part: Any, where: Where, owner: str, site: MissionSite) -> Iterator[Handle]:
    """The places in the arguments of an action, or in an area."""
    for key, found in _entries(part):
        name = key.removesuffix("_m")
        if name == "circle":
            yield from _single(found, (*where, key, "center" if key == name else "center_m"), owner, site)
        elif name in _LISTS and isinstance(found, list):
            for index, numbers in enumerate(found):
                place = _place(numbers, site)
                if place is not None:
                    kind = _LISTS[name]
                    label = f"{kind} {index + 1} of {owner}"
                    yield Handle((*where, key, index), kind, label, place, _height(numbers, kind), len(found))
        elif name in _SINGLES:
            yield from _single(part, (*where, key), owner, site)


def _single(part: Any, where: Where, owner: str, site: MissionSite) -> Iterator[Handle]:
    numbers = part.get(where[-1]) if isinstance(part, dict) else None
    place = _place(numbers, site)
    kind = _SINGLES[str(where[-1]).removesuffix("_m")]
    if place is not None:
        yield Handle(where, kind, f"{kind} of {owner}", place, _height(numbers, kind))


def _height(numbers: Any, kind: HandleKind) -> float | None:
    return float(numbers[2]) if kind is HandleKind.WAYPOINT and len(numbers) == 3 else None


def _place(numbers: Any, site: MissionSite) -> Point | None:
    is_place = isinstance(numbers, list) and len(numbers) in (2, 3)
    if not is_place or not all(isinstance(one, int | float) and not isinstance(one, bool) for one in numbers):
        return None
    try:
        north, east, _ = site.level.ned_from((float(numbers[0]), float(numbers[1]), 0.0))
    except Refused:
        return None
    return north, east


def _entries(value: Any, *path: str) -> Iterator[tuple[str, Any]]:
    for key in path:
        value = value.get(key) if isinstance(value, dict) else None
    yield from value.items() if isinstance(value, dict) else ()
