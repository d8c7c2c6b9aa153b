"""What the map page draws, as plain data in metres north and east on the plane of the selected vehicle."""

from collections.abc import Iterable
from math import isfinite
from typing import Any, Final

import msgspec
import numpy as np

from gloc3.mission.model.states import ENDED, ActionState
from gloc3_groundstation.mapping.ground import Ground, MapPlacement, Plane, heading_deg_of, outline, position_of
from gloc3_groundstation.mapping.requested import Requested
from gloc3_groundstation.mapping.tracks import Tracks
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot

MOST_POINTS: Final = 2_000
"""Points of a trail in one message; the next ones follow in the next."""

Place = tuple[float, float]
"""Metres north and east."""


class MapVehicle(msgspec.Struct, frozen=True, kw_only=True):
    """A vehicle on the map."""

    name: str
    number: int
    """From 0, in the order of first contact: its colour."""
    place: Place | None = None
    """None where it is unknown, or not on this map."""
    height_m: float | None = None
    heading_deg: float | None = None
    """None where it is not known."""
    wanted: Place | None = None
    """Its position setpoint."""
    speed_m_s: float = 0.0
    mode: str = ""
    is_armed: bool = False
    battery_percent: int = -1
    age_s: float = 0.0
    is_stale: bool = True


class MapPath(msgspec.Struct, frozen=True, kw_only=True):
    """Path of one action of a mission."""

    points: tuple[Place, ...]
    is_over: bool


class MapPicture(msgspec.Struct, frozen=True, kw_only=True):
    """The vehicles on the map."""

    selected: str
    key: str
    """Changes when metres north and east are those of another plane."""
    origin: tuple[float, float, float] | None
    """Of the plane: latitude and longitude in degrees, altitude in metres; None where it is unknown."""
    frame: str
    has_north: bool
    vehicles: tuple[MapVehicle, ...]


class MapPlan(msgspec.Struct, frozen=True, kw_only=True):
    """The mission, fence and home of the selected vehicle."""

    home: Place | None = None
    mission: str = ""
    is_loaded: bool = False
    """Whether the vehicle has the mission that is drawn."""
    paths: tuple[MapPath, ...] = ()
    waypoints: tuple[Place, ...] = ()
    fence: tuple[Place, ...] = ()
    keep_out: tuple[tuple[Place, ...], ...] = ()


def picture_of(fleet: Fleet, selected: PlatformSnapshot | None, ground: Ground, now_s: float) -> MapPicture:
    """The vehicles on the plane of the selected one.

    Args:
        fleet: all vehicles.
        selected: the vehicle whose frame is the map's; None before the first contact.
        ground: its plane.
        now_s: on the station's clock.
    """
    return MapPicture(
        selected=selected.name if selected is not None else "",
        key=key_of(ground),
        origin=ground.origin,
        frame=ground.frame,
        has_north=ground.has_north,
        vehicles=tuple(_vehicle(number, platform, ground, now_s) for number, platform in enumerate(fleet)),
    )


def plan_of(
    selected: PlatformSnapshot | None, ground: Ground, request: Requested | None, *, is_loaded: bool
) -> MapPlan:
    """What the selected vehicle is to fly.

    Args:
        selected: the vehicle.
        ground: its plane.
        request: its mission; None without one.
        is_loaded: whether the vehicle has that loaded.
    """
    own = (ground.place(selected) if selected is not None else None) or MapPlacement()
    site = ground.site
    home = None if site is None or site.home_m is None else _rounded(own.point(site.home_m)[:2])
    if request is None:
        return MapPlan(home=home)
    fence = request.fence
    tasks = selected.mission.value.tasks if is_loaded and selected is not None and selected.mission is not None else {}
    ended = {target for target, state in tasks.items() if state in list(ActionState) and ActionState(state) in ENDED}
    return MapPlan(
        home=home,
        mission=request.name,
        is_loaded=is_loaded,
        paths=tuple(
            MapPath(points=_places(own.from_ned(np.array(path.points_ned_m))), is_over=path.target in ended)
            for path in request.paths
        ),
        waypoints=_places(own.from_ned(np.array([point.position_ned_m for point in request.waypoints]).reshape(-1, 3))),
        fence=() if fence is None or fence.area is None else _places(own.plane_of_ne(outline(fence.area))),
        keep_out=() if fence is None else tuple(_places(own.plane_of_ne(outline(area))) for area in fence.keep_out),
    )


def key_of(ground: Ground) -> str:
    """Names the plane of a map."""
    return repr(ground)


class TrailFeed:
    """The trails of all vehicles for one page, each point once.

    Args:
        tracks: where the vehicles have been.
    """

    def __init__(self, tracks: Tracks) -> None:
        self._tracks = tracks
        self._key = ""
        self._until_s: dict[str, float] = {}

    def new(self, ground: Ground, platforms: Iterable[PlatformSnapshot]) -> dict[str, Any] | None:
        """The points that have not been sent, by vehicle; None where there are none.

        A trail on another plane, or one that was cleared, is sent as a whole, with `is_new`. A gap is a null.
        """
        key = key_of(ground)
        if key != self._key:
            self._key, self._until_s = key, {}
        found: dict[str, Any] = {}
        for platform in platforms:
            track, place = self._tracks.get(platform.name), ground.place(platform)
            if track is None or place is None or not len(track.trail):
                continue
            until_s = self._until_s.get(platform.name)
            points = track.trail.points
            times = points[:, 3]
            if until_s is not None and not until_s >= np.nanmin(times, initial=np.inf):
                until_s = None  # it was cleared, and has begun again
            new = np.flatnonzero(times > (float("-inf") if until_s is None else until_s))
            if not len(new):
                continue
            first = int(new[0])
            first -= first > 0 and bool(np.isnan(times[first - 1]))  # the gap before it
            points = points[first : new[:MOST_POINTS][-1] + 1]
            if len(points):
                self._until_s[platform.name] = float(points[-1, 3])
                found[platform.name] = {
                    "is_new": until_s is None,
                    "points": _places_with_gaps(place.plane(points[:, :2])),
                }
        return found or None


def _vehicle(number: int, platform: PlatformSnapshot, ground: Ground, now_s: float) -> MapVehicle:
    vehicle, position, place = platform.vehicle, position_of(platform), ground.place(platform)
    found = MapVehicle(name=platform.name, number=number, age_s=round(platform.age_s(now_s), 1))
    if vehicle is None:
        return found
    motion = platform.motion.value if platform.motion is not None else None
    on_map = None if position is None or place is None else place.point(position)
    wanted = None
    if motion is not None and motion.setpoint_cm is not None and place is not None:
        x, y, height = (value / 100.0 for value in motion.setpoint_cm)
        wanted = _rounded(place.point((x, y, height))[:2])
    return msgspec.structs.replace(
        found,
        place=None if on_map is None else _rounded(on_map[:2]),
        height_m=None if position is None or not isfinite(position[2]) else round(position[2], 1),
        heading_deg=None if vehicle.value.heading_deg < 0 else round(heading_deg_of(platform), 1),
        wanted=wanted,
        speed_m_s=round(vehicle.value.speed_m_s, 1),
        mode=vehicle.value.mode,
        is_armed=vehicle.value.is_armed,
        battery_percent=vehicle.value.battery_percent,
        is_stale=vehicle.is_stale(now_s),
    )


def _rounded(place: tuple[float, ...]) -> Place | None:
    north, east = place
    return (round(north, 2), round(east, 2)) if isfinite(north) and isfinite(east) else None


def _places(plane: Plane) -> tuple[Place, ...]:
    return tuple((round(float(north), 2), round(float(east), 2)) for north, east in plane)


def _places_with_gaps(plane: Plane) -> list[Place | None]:
    return [_rounded((float(north), float(east))) for north, east in plane]
