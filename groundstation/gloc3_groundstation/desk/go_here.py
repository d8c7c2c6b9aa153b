"""Sending a vehicle, or its home, to a place on a map: checked, asked about, and commanded by the desk, on every map alike."""

from contextlib import suppress
from math import atan2, degrees, hypot, isfinite
from typing import Any, Final

import msgspec

from gloc3.errors import Refused
from gloc3.messages.frames import GeoPoint
from gloc3.terrain import GroundLevel
from gloc3_groundstation.desk.control import require_control
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.mapping.ground import Ground, MapPlacement, position_of
from gloc3_groundstation.missions.forms import arguments_of
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import PlatformSnapshot

CAPABILITY: Final = "go_to"


class GoToRequest(msgspec.Struct, frozen=True, kw_only=True):
    """A place that the operator is asked to confirm."""

    vehicle: str
    question: str
    height_m: float
    """What is proposed: the height that it has now."""
    height_name: str
    """From where the height counts."""
    is_own: bool
    """Whether its autopilot is commanded itself, without a companion."""
    field: str = ""
    """The argument of the companion's capability."""
    place: tuple[float, float] = (0.0, 0.0)
    """Latitude and longitude in degrees, or x and y in metres, as the command has them."""


def go_to_request(desk: Desk, platform: PlatformSnapshot, ground: Ground, north_m: float, east_m: float) -> GoToRequest:
    """Checks a place on a map, and prepares the question.

    Args:
        desk: commands the vehicle.
        platform: the vehicle.
        ground: the map's plane.
        north_m: of the plane's origin.
        east_m: of the plane's origin.

    Raises:
        Refused: the vehicle cannot be sent there.
    """
    vehicle, position = platform.name, position_of(platform)
    if position is None or platform.vehicle is None:
        raise Refused(f"the position of {vehicle} is not known")
    if platform.vehicle.is_stale(desk.station.now_s()):
        raise Refused(f"the position of {vehicle} is {platform.vehicle.age_s(desk.station.now_s()):.0f} s old")
    own = ground.place(platform) or MapPlacement()
    here = own.point(position)
    away_m = hypot(north_m - here[0], east_m - here[1])
    bearing_deg = degrees(atan2(east_m - here[1], north_m - here[0])) % 360.0
    where = f"{away_m:.0f} m away{f', bearing {wording.bearing(bearing_deg)}' if ground.has_north else ''}"
    is_own = desk.autopilots.is_its_own(platform)
    if is_own and Action.GO_TO not in desk.autopilots.offers(platform):
        raise Refused("it is not armed: take off first")
    field = "" if is_own else _field(desk, platform)
    if is_own or field == "position":
        geo = ground.geo(north_m, east_m)
        if geo is None:
            raise Refused("the map has no place on Earth, and the command needs one")
        place, text = (geo.latitude_deg, geo.longitude_deg), f"{geo.latitude_deg:.6f}°, {geo.longitude_deg:.6f}°"
        home_m = ground.site.home_m if ground.site is not None else None
        above_m = position[2] - (home_m[2] if home_m is not None else 0.0)
        height_m, height_name = platform.vehicle.value.position_m[2] if is_own else above_m, "above home"
    else:
        place = own.local(north_m, east_m)
        text = f"x {place[0]:.1f} m, y {place[1]:.1f} m"
        height_m, height_name = position[2], f"in frame {ground.frame}" if ground.frame else "above the origin"
    arms = not is_own and desk.missions.arms(vehicle, CAPABILITY)
    return GoToRequest(
        vehicle=vehicle,
        question=f"Send {vehicle} to {text}, {where}?" + (" It arms and starts moving." if arms else ""),
        height_m=round(height_m, 1),
        height_name=height_name,
        is_own=is_own,
        field=field,
        place=place,
    )


async def go_to(desk: Desk, request: GoToRequest, height_m: float) -> str:
    """Carries out what was confirmed.

    Returns:
        What became of it, for the operator.

    Raises:
        Gloc3Error: it was refused, with the reason.
    """
    if not isfinite(height_m):
        raise Refused("the height must be a number")
    numbers = (*request.place, height_m)
    if request.is_own:
        typed = f"{numbers[0]:.8f}, {numbers[1]:.8f}, {numbers[2]:.2f}"
        if not await desk.autopilots.act(request.vehicle, Action.GO_TO, typed):
            raise Refused(last_event(desk, request.vehicle))
        return f"{request.vehicle}: go to: accepted by the autopilot"
    row = desk.missions.capabilities(request.vehicle)[CAPABILITY]
    form = desk.missions.form(request.vehicle, CAPABILITY)
    arguments: dict[str, Any] = arguments_of(form, row, {request.field: ", ".join(f"{one:.8f}" for one in numbers)})
    name = await desk.missions.request(request.vehicle, CAPABILITY, arguments)
    return f"{request.vehicle}: go to: accepted as {name or 'a single action'}"


class HomeRequest(msgspec.Struct, frozen=True, kw_only=True):
    """A new home that the operator is asked to confirm."""

    vehicle: str
    question: str
    place: GeoPoint
    """With the altitude that is proposed: the ground's where there are tiles, else that of the present home."""


def home_request(desk: Desk, platform: PlatformSnapshot, ground: Ground, north_m: float, east_m: float) -> HomeRequest:
    """Checks a place on a map for the home of a vehicle's autopilot, and prepares the question.

    Args:
        desk: commands the vehicle.
        platform: the vehicle.
        ground: the map's plane.
        north_m: of the plane's origin.
        east_m: of the plane's origin.

    Raises:
        Refused: this station may not, or the map or the present home is not known.
    """
    require_control(desk.station, platform.name)
    geo, autopilot = ground.geo(north_m, east_m), platform.autopilot
    if geo is None or ground.plane is None:
        raise Refused("the map has no place on Earth, and home needs one")
    if autopilot is None or not autopilot.is_alive:
        raise Refused(f"the autopilot of {platform.name} is not received on a MAVLink link of this station")
    if autopilot.home_geo is None:
        raise Refused(f"the autopilot of {platform.name} has not reported its present home")
    here = ground.plane.ned_from_geo(*autopilot.home_geo)
    terrain, altitude_m = desk.station.terrain, autopilot.home_geo[2]
    if terrain is not None:
        with suppress(Refused):  # no tile there
            altitude_m = GroundLevel.under(terrain, GeoPoint(*autopilot.home_geo)).altitude_m(*geo[:2])
    where = f"{geo.latitude_deg:.6f}°, {geo.longitude_deg:.6f}°"
    lines = [f"Move the home of {platform.name} by {hypot(north_m - here[0], east_m - here[1]):.0f} m to {where}?"]
    lines.append("Its autopilot returns there, and its heights above home count from there.")
    if platform.has_companion:
        lines.append("return_home of a mission still goes to where the vehicle was armed.")
    if platform.is_armed:
        lines.insert(0, f"{platform.name} is ARMED.")
    return HomeRequest(vehicle=platform.name, question="\n".join(lines), place=geo._replace(altitude_m=altitude_m))


def _field(desk: Desk, platform: PlatformSnapshot) -> str:
    """The argument of the companion's capability that takes a place."""
    if CAPABILITY not in desk.missions.capabilities(platform.name):
        raise Refused(f"{platform.name} has no capability {CAPABILITY}")
    form = desk.missions.form(platform.name, CAPABILITY)
    fields = [field.name for field in form.fields if field.name in ("position", "position_m")]
    if not fields:
        raise Refused(f"the arguments of {CAPABILITY} are not known here")
    return fields[0]


def last_event(desk: Desk, vehicle: str) -> str:
    """The text of a vehicle's last event, which says why something was not carried out."""
    found = [event.text for event in desk.station.fleet.events if event.platform == vehicle]
    return found[-1] if found else "it was not carried out"
