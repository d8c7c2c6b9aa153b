"""Place of a mission: its frame on Earth, the origin of NED, and the ground below."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple, Protocol

from gloc3.documents.document import Document
from gloc3.errors import Finding, Refused, nearest
from gloc3.messages.frames import GeoPoint, LocalFrame, Vector3
from gloc3.mission.model.model import GEO
from gloc3.mission.model.placement import GeoPlacement, HeightAbove, LocalPlacement, PlacedPath, Placement
from gloc3.terrain import GroundLevel, Terrain, follow_ground

_POSITION_KEYS: Final = ("polygon", "waypoints", "position", "at", "center", "area", "wall", "to")
DOUBTED_M: Final = 30.0
"""A greater difference between an autopilot's altitude of home and the tile's height there is reported."""
_EARTH: Final = GeoPoint(0.0, 0.0, 0.0)


class GroundPlacement(GeoPlacement):
    """Positions `[latitude, longitude, height above the ground]`; paths follow the ground between them."""

    def __init__(self, origin: GeoPoint, ground: GroundLevel, home_altitude_m: float | None = None) -> None:
        """A placement.

        Args:
            origin: the origin of NED.
            ground: the ground's height.
            home_altitude_m: as for `GeoPlacement`; heights without a place, such as a ceiling's, count from there.
        """
        super().__init__(origin, HeightAbove.GROUND, home_altitude_m)
        self._ground = ground

    def ned_from(self, position: Vector3) -> Vector3:
        """The NED position of `[latitude, longitude, height]`.

        Raises:
            Refused: no tile tells how high the ground is there.
        """
        latitude, longitude, height = position
        return self._plane.ned_from_geo(latitude, longitude, height + self._ground.altitude_m(latitude, longitude))

    def path_from(self, positions: Sequence[Vector3]) -> PlacedPath:
        """From position to position, with places between them wherever the ground is not straight.

        Raises:
            Refused: no tile tells how high the ground is somewhere.
        """
        return PlacedPath(*follow_ground(positions, self._plane, self._ground))


class SiteReferences(Protocol):
    """What is known of the vehicle's place; see `MissionReferences`."""

    @property
    def frames(self) -> Mapping[str, LocalFrame] | None:
        """Local frames by name."""

    @property
    def origin(self) -> GeoPoint | None:
        """Origin of NED."""

    @property
    def home_altitude_m(self) -> float | None:
        """Altitude above the sea of home."""

    @property
    def home(self) -> GeoPoint | None:
        """Where the vehicle was armed."""

    @property
    def terrain(self) -> Terrain | None:
        """Heights of the ground."""

    @property
    def is_ground_level(self) -> bool:
        """Whether heights above the ground may be taken as above home."""


class MissionSite(NamedTuple):
    """Where a mission's positions are."""

    placement: Placement
    level: Placement
    """For the fence, whose ceiling is level: with heights above the ground it counts from home."""
    origin: GeoPoint | None = None
    """Of NED; None where the frame has no known place on Earth."""
    ground: GroundLevel | None = None
    """The ground; None without tiles, or without one at home."""
    gap: str = ""
    """Why there is no ground although there are tiles."""


def site_of(
    document: Document, surroundings: SiteReferences, planned: GeoPoint | None, findings: list[Finding]
) -> MissionSite | None:
    """Finds the place of a mission; None where that is not possible, with the reason in the findings.

    Args:
        document: the mission.
        surroundings: what is known of the vehicle's place.
        planned: the first place of the plans that it names; None without.
        findings: are appended to.
    """
    frame = document.value.get("frame")
    if not isinstance(frame, str):
        return None
    if frame != GEO:
        return _local(frame, document, surroundings, findings)
    written = document.value
    above = written.get("height_above", "home")
    if above not in list(HeightAbove):
        return None
    if surroundings.origin is None and above == HeightAbove.SEA:
        message = "the altitude of home is not known here; 0 m is assumed"
        findings.append(document.finding(("height_above",), message, is_warning=True))
    origin = surroundings.origin or planned or _first_position(written.get("tasks"))
    origin = origin or _first_position(written) or _EARTH
    home_altitude_m = surroundings.home_altitude_m
    level = GeoPlacement(origin, HeightAbove(above), home_altitude_m)
    home = surroundings.home or origin._replace(
        altitude_m=origin.altitude_m if home_altitude_m is None else home_altitude_m
    )
    ground, gap = _ground(surroundings.terrain, home, HeightAbove(above))
    if above != HeightAbove.GROUND:
        return MissionSite(level, level, origin, ground, gap)
    if ground is None and surroundings.terrain is None and surroundings.is_ground_level:
        return MissionSite(level, level, origin)
    if ground is None:
        message = f"heights above the ground need terrain tiles: {gap or 'none are given'}"
        hint = "add the tile, or count heights from home" if gap else "name their folder: --terrain DIR"
        findings.append(document.finding(("height_above",), message, hint))
        return None
    findings += _doubts(document, ground, surroundings.home)
    return MissionSite(GroundPlacement(origin, ground, home_altitude_m), level, origin, ground)


def _local(frame: str, document: Document, surroundings: SiteReferences, findings: list[Finding]) -> MissionSite | None:
    if surroundings.frames is None:
        hint = "name a platform or world that declares it"
        message = f"frame {frame!r} is not known here; x is assumed to be north"
        findings.append(document.finding(("frame",), message, hint, is_warning=True))
        placement = LocalPlacement(LocalFrame(_EARTH))
        return MissionSite(placement, placement)
    if frame not in surroundings.frames:
        hint = nearest(frame, [*surroundings.frames, GEO])
        findings.append(document.finding(("frame",), f"unknown frame {frame!r}", hint))
        return None
    placement = LocalPlacement(surroundings.frames[frame], surroundings.origin)
    origin = surroundings.origin or surroundings.frames[frame].origin
    ground, gap = _ground(surroundings.terrain, surroundings.home or origin, HeightAbove.HOME)
    return MissionSite(placement, placement, origin, ground, gap)


def _ground(terrain: Terrain | None, home: GeoPoint, above: HeightAbove) -> tuple[GroundLevel | None, str]:
    """The ground, or why it is not known."""
    if terrain is None:
        return None, ""
    if above is HeightAbove.SEA:
        return GroundLevel(terrain), ""
    try:
        return GroundLevel.under(terrain, home), ""
    except Refused as refusal:
        return None, str(refusal)


def _doubts(document: Document, ground: GroundLevel, home: GeoPoint | None) -> list[Finding]:
    """A ceiling, which is level; and an altitude of home that the tiles contradict."""
    found: list[Finding] = []
    if "geofence" in document.root.children and "ceiling_m" in document.node(("geofence",)).children:
        message = "the ceiling is level: it counts from home, and not from the ground below"
        found.append(document.finding(("geofence", "ceiling_m"), message, is_warning=True))
    if home is not None and abs(ground.offset_m) > DOUBTED_M:
        by_tile_m = home.altitude_m - ground.offset_m
        message = (
            f"home is {home.altitude_m:.0f} m above the sea by the autopilot, {by_tile_m:.0f} m by the terrain tile"
        )
        hint = "is it the right tile? heights are counted from home"
        found.append(document.finding(("height_above",), message, hint, is_warning=True))
    return found


def _first_position(value: Any) -> GeoPoint | None:
    """The first latitude and longitude in a part of a file, at sea level; None without any."""
    waiting: list[tuple[str, Any]] = [("", value)]
    while waiting:
        key, found = waiting.pop()
        if isinstance(found, dict):
            waiting += reversed([(str(name), inner) for name, inner in found.items()])
        elif isinstance(found, list) and found and key in _POSITION_KEYS:
            if isinstance(found[0], list):
                waiting.append((key, found[0]))
            elif len(found) >= 2 and all(isinstance(part, int | float) for part in found[:2]):
                return GeoPoint(max(-90.0, min(90.0, float(found[0]))), float(found[1]), 0.0)
    return None
