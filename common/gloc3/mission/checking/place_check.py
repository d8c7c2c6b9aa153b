"""Plausibility of places on Earth: swapped latitudes and longitudes, and places far from the vehicle."""

from collections.abc import Iterator
from math import asin, cos, radians, sin, sqrt
from typing import Final, NamedTuple

from gloc3.documents.document import Where
from gloc3.errors import Finding
from gloc3.messages.frames import GeoPoint
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.formats.commands import COMMANDS
from gloc3.mission.formats.items import ForeignPlan
from gloc3.mission.model.model import GEO, Mission, where_of

DOUBTED_M: Final = 2_000.0
"""A first place so far from the vehicle is doubted."""
FARTHEST_M: Final = 100_000.0
"""No vehicle flies so far from one place of a mission to the next."""
_EARTH_M: Final = 6_371_000.0
_POSITIONS: Final = ("waypoints", "to", "area", "wall")
_SWAPPED_HINT: Final = "write latitude first, then longitude"

LatLon = tuple[float, float]


class PlaceDoubt(NamedTuple):
    """Why a place is not plausible."""

    text: str
    """What follows the name of the place, as `is 5.2 km from home`."""
    hint: str
    is_certain: bool
    """Whether it cannot be meant so."""


def place_doubt(place: LatLon, reference: LatLon, called: str) -> PlaceDoubt | None:
    """Why a place is not plausible, seen from another one.

    Args:
        place: latitude and longitude, degrees.
        reference: where the vehicle is, or was before.
        called: name of the reference for people.
    """
    away_m = distance_m(place, reference)
    if away_m <= DOUBTED_M:
        return None
    swapped_m = distance_m((place[1], place[0]), reference) if abs(place[1]) <= 90.0 else away_m
    text = f"is {_far(away_m)} from {called}"
    if swapped_m < 0.1 * away_m:
        hint = f"{_SWAPPED_HINT}: swapped, it is {_far(swapped_m)} from {called}"
        return PlaceDoubt(f"{text}: latitude and longitude seem to be swapped", hint, True)
    return PlaceDoubt(text, "is it the right place?", away_m > FARTHEST_M)


def distance_m(one: LatLon, other: LatLon) -> float:
    """Distance of two places over ground, on a sphere."""
    north, south = radians(one[0]), radians(other[0])
    half_ns, half_ew = (north - south) / 2.0, radians(one[1] - other[1]) / 2.0
    chord = sin(half_ns) ** 2 + cos(north) * cos(south) * sin(half_ew) ** 2
    return 2.0 * _EARTH_M * asin(min(1.0, sqrt(chord)))


def _far(metres: float) -> str:
    return f"{metres:.0f} m" if metres < 1_000.0 else f"{metres / 1_000.0:,.1f} km"


def place_findings(mission: Mission, home: GeoPoint | None) -> Iterator[Finding]:
    """Places of a mission in frame geo that are not plausible: the first from home, each from the one before it.

    Args:
        mission: that was read.
        home: where the vehicle stands; None where it is not known.
    """
    document = mission.document
    if document is None or mission.frame != GEO:
        return
    before, called = ((home.latitude_deg, home.longitude_deg), "home") if home is not None else (None, "")
    is_first = home is not None
    for where, place, name in _places(mission):
        doubt = place_doubt(place, before, called) if before is not None else None
        if doubt is not None and (doubt.is_certain or is_first):
            message = f"{name} {doubt.text}"
            yield document.finding(where, message, doubt.hint, is_warning=not doubt.is_certain)
            if doubt.is_certain:
                return  # the others are no better
        before, called, is_first = place, "the place before it", False


def _places(mission: Mission) -> Iterator[tuple[Where, LatLon, str]]:
    """Where each place stands in the mission, the place, and its name for people."""
    for target, action in mission.actions().items():
        if isinstance(action.order, FlyFileOrder):
            where = (*where_of(target)[:2], "plan")
            if action.order.home is not None and any(action.order.home[:2]):
                yield where, action.order.home[:2], "its planned home"
            yield from ((where, one.lat_lon, f"{one.name},") for one in action.order.path if one.lat_lon is not None)
            continue
        where = (*where_of(target), action.capability)
        for name in _POSITIONS:
            places = getattr(action.arguments, name, None) or ()
            for index, place in enumerate(() if isinstance(places, str) else places):  # `to` of a transition is a word
                yield (*where, name, index), (place[0], place[1]), f"[{place[0]:g}, {place[1]:g}]"
        for name in ("position", "at"):
            place = getattr(action.arguments, name, None)
            if place is not None:
                yield (*where, name), (place[0], place[1]), f"[{place[0]:g}, {place[1]:g}]"


def plan_place_findings(plan: ForeignPlan, file: str) -> Iterator[Finding]:
    """The same of another program's plan, with the lines of its file."""
    before, called = (plan.home[:2], "home") if plan.home is not None and any(plan.home[:2]) else (None, "")
    is_first = before is not None
    for number, item in enumerate(plan.items, start=1):
        command = COMMANDS.get(item.command)
        if command is None or not command.goes_to or not item.has_position:
            continue
        place = (item.x or 0.0, item.y or 0.0)
        line = plan.line_of(number)
        if abs(place[0]) > 90.0 or abs(place[1]) > 180.0:
            message = f"item {number}, {command.name}: {place[0]:g}, {place[1]:g} is not a latitude and longitude"
            hint = _SWAPPED_HINT if abs(place[1]) <= 90.0 and abs(place[0]) <= 180.0 else ""
            yield Finding(file=file, line=line, column=1 if line else 0, message=message, hint=hint)
            return
        doubt = place_doubt(place, before, called) if before is not None else None
        if doubt is not None and (doubt.is_certain or is_first):
            message = f"item {number}, {command.name}, {doubt.text}"
            yield Finding(
                file=file,
                line=line,
                column=1 if line else 0,
                message=message,
                hint=doubt.hint,
                is_warning=not doubt.is_certain,
            )
            if doubt.is_certain:
                return
        before, called, is_first = place, "the place before it", False
