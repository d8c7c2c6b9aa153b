"""Converts another program's plan to a mission of GLOC3, and reports what cannot be expressed.

Each line of the mission that comes of an item says so in a comment (`source_lines` has the form): findings about the
mission name the line of the plan from it.
"""

from collections.abc import Callable
from math import cos, hypot, radians
from typing import Any, Final

from gloc3.documents.document import dump
from gloc3.documents.format_version import STAMP
from gloc3.errors import Finding, InputError
from gloc3.mission.formats.commands import command_name
from gloc3.mission.formats.items import MULTIROTORS, FenceArea, ForeignPlan, MavItem
from gloc3.mission.formats.losses import losses
from gloc3.mission.formats.source_lines import with_sources
from gloc3.mission.model.abilities import departure
from gloc3.mission.model.placement import HeightAbove
from gloc3.platform.platform import Platform

DEFAULT_SPEED_M_S: Final = 5.0
"""Of a plan that says nothing of speed."""
NEAR_M: Final = 1.0
"""A take-off position so near to the planned home is home."""
FLY_IT_AS_IT_IS: Final = "take it out, or have the autopilot fly the plan as it is: gloc3 mission convert --as-it-is"

_HEIGHT_ABOVE: Final = {
    0: HeightAbove.SEA,
    5: HeightAbove.SEA,
    3: HeightAbove.HOME,
    6: HeightAbove.HOME,
    10: HeightAbove.GROUND,
    11: HeightAbove.GROUND,
}
_ARDUPILOT: Final = 3
_METRES_PER_DEGREE: Final = 111_320.0
LEFT_OUT: Final = {
    189: "DO_LAND_START",
    200: "DO_CONTROL_VIDEO",
    202: "DO_DIGICAM_CONFIGURE",
    203: "DO_DIGICAM_CONTROL",
    204: "DO_MOUNT_CONFIGURE",
    205: "DO_MOUNT_CONTROL",
    206: "DO_SET_CAM_TRIGG_DIST",
    214: "DO_SET_CAM_TRIGG_INTERVAL",
    530: "SET_CAMERA_MODE",
    1000: "DO_GIMBAL_MANAGER_PITCHYAW",
    2000: "IMAGE_START_CAPTURE",
    2001: "IMAGE_STOP_CAPTURE",
    2500: "VIDEO_START_CAPTURE",
    2501: "VIDEO_STOP_CAPTURE",
}
"""Commands that do not move the vehicle: a mission without them has the same path."""


def to_mission(plan: ForeignPlan, name: str, file: str, platform: Platform | None = None) -> tuple[str, list[Finding]]:
    """Converts a plan to the text of a mission with the same path.

    Args:
        plan: the plan.
        name: of the mission.
        file: name of the plan in findings.
        platform: that flies it: faster parts are flown at its limit, and it departs in its own way. None for any.

    Returns:
        The YAML, and warnings about parts that were left out or changed.

    Raises:
        InputError: an item that moves or limits the vehicle cannot be expressed.
    """
    return _Converter(plan, name, file, platform).mission()


class _Converter:
    """Goes through the items in their order."""

    def __init__(self, plan: ForeignPlan, name: str, file: str, platform: Platform | None) -> None:
        self._plan, self._name, self._file = plan, name, file
        self._platform = platform
        self._limit_m_s = platform.limits.speed_m_s if platform is not None else None
        self._departs = departure(platform) if platform is not None else "take_off"
        self._findings: list[Finding] = list(plan.findings)
        self._actions: dict[str, dict[str, Any]] = {}
        self._waypoints: list[list[float]] = []
        self._numbers: list[int] = []
        """The items of all waypoints, in order."""
        self._number_of: dict[str, int] = {}
        """The item of each action."""
        self._place: tuple[float, float] | None = None
        """Where the last item with a position leads."""
        self._heading: Any = "along"
        self._flown_heading: Any = "along"
        self._begin_region_of_interest: dict[str, Any] | None = None
        self._height_above = _common_reference(plan.items)
        self._flat = 0
        """How many heights are left out, because the vehicle stays on the ground."""
        is_hovering = plan.vehicle_type is None or plan.vehicle_type in MULTIROTORS
        speed_m_s = plan.hover_speed_m_s if is_hovering else plan.cruise_speed_m_s
        self._speed_m_s = speed_m_s or DEFAULT_SPEED_M_S
        self._home = plan.home if plan.home is not None and any(plan.home[:2]) else None

    def mission(self) -> tuple[str, list[Finding]]:
        if self._home is not None:
            self._place = self._home[:2]
        for number, item in enumerate(self._plan.items, start=1):
            self._convert(item, number)
        self._end_flight(len(self._plan.items))
        if not self._actions:
            hint = "its fence and rally points go to the autopilot: upload it there" if self._is_parts_alone else ""
            self._findings.append(Finding(file=self._file, message="it has no item that moves the vehicle", hint=hint))
        if self._flat:
            hint = "set them to 0 in the plan"
            self._warn(0, f"the heights of {self._flat} items are left out: the vehicle stays at height 0", hint)
        written: dict[str, Any] = {**STAMP, "mission": self._name, "frame": "geo"}
        if self._height_above not in (None, HeightAbove.HOME):
            written["height_above"] = str(self._height_above)
        geofence = geofence_of(self._plan.fence, self._file, self._findings)
        if geofence:
            written["geofence"] = geofence
        if self._plan.rally:
            self._warn(0, "the rally points are left out", "the mission returns to its home")
        if any(not finding.is_warning for finding in self._findings):
            raise InputError(sorted(self._findings))
        text = dump(written | {"tasks": {"fly": {"actions": self._actions}}})
        return with_sources(text, self._number_of, self._numbers, self._plan), self._findings

    @property
    def _is_parts_alone(self) -> bool:
        return bool(self._plan.fence or self._plan.rally) and not self._plan.items

    def _convert(self, item: MavItem, number: int) -> None:
        handler = _HANDLERS.get(item.command)
        if handler is not None:
            if not self._actions and not self._waypoints and item.command in _MOVING:
                self._depart(item, number)
            handler(self, item, number)
            for message, hint in losses(item):
                self._warn(number, f"{_called(item, number)}: {message}", hint)
        elif item.command in LEFT_OUT:
            self._warn(number, f"{_called(item, number)}, is left out", "add record_images by hand")
        else:
            self._refuse(item, number, "cannot be expressed in a mission")

    def _depart(self, item: MavItem, number: int) -> None:
        """Begins with the vehicle's own way of setting off, where the plan has none that fits."""
        if item.command in _TAKE_OFFS and self._departs == "take_off":
            return
        if self._departs == "dive" and (item.z or 0.0) < 0.0 and _above(item) is HeightAbove.HOME:
            self._add("depart", "dive", {"depth_m": -(item.z or 0.0)}, number)
        else:
            self._add("depart", "depart", {}, number)
        if item.command not in _TAKE_OFFS and self._departs == "take_off":
            self._warn(number, "the plan has no take-off: the mission begins with depart", "begin with NAV_TAKEOFF")

    def _warn(self, number: int, message: str, hint: str = "") -> None:
        line = self._plan.line_of(number)
        column = 1 if line else 0
        found = Finding(file=self._file, line=line, column=column, message=message, hint=hint, is_warning=True)
        self._findings.append(found)

    def _refuse(self, item: MavItem, number: int, message: str, hint: str = FLY_IT_AS_IT_IS) -> None:
        line = self._plan.line_of(number)
        text = f"{_called(item, number)}: {message}"
        self._findings.append(Finding(file=self._file, line=line, column=1 if line else 0, message=text, hint=hint))

    def _add(self, name: str, capability: str, arguments: dict[str, Any], number: int) -> None:
        previous = list(self._actions)[-1:]
        count = sum(key == name or key.startswith(name + "_") for key in self._actions)
        action: dict[str, Any] = {capability: arguments}
        if previous:
            action["after"] = previous
        unique = f"{name}_{count + 1}" if count else name
        self._actions[unique], self._number_of[unique] = action, number

    def _end_flight(self, number: int) -> None:
        """Makes one action of the waypoints so far."""
        if self._waypoints:
            first = self._numbers[-len(self._waypoints)]
            arguments: dict[str, Any] = {"waypoints": self._waypoints, "speed_m_s": self._limited(number)}
            if self._flown_heading != "along":
                arguments["heading"] = self._flown_heading
            self._add("way", "follow_waypoints", arguments, first)
            self._waypoints = []

    def _position(self, item: MavItem, number: int) -> list[float] | None:
        """The place of an item, its height counted as those of all; None after a refusal."""
        place = (item.x or 0.0, item.y or 0.0) if item.has_position else self._place
        if place is None:
            hint = "give it a position, or the plan a home"
            self._refuse(item, number, "it has no position, and there is none before it", hint)
            return None
        above = _above(item)
        if above is None:
            self._refuse(item, number, f"frame {item.frame} of its position cannot be expressed", "use a global frame")
            return None
        height_m = self._height(item, above, number)
        if height_m is None:
            return None
        self._place = place
        return [*place, height_m]

    def _height(self, item: MavItem, above: HeightAbove, number: int) -> float | None:
        """The height of an item, counted from where all heights of the mission count from."""
        height_m, wanted = item.z or 0.0, self._height_above or HeightAbove.HOME
        if self._departs == "drive_off" and wanted is HeightAbove.HOME:
            self._flat += height_m != 0.0 and above is not HeightAbove.SEA
            return 0.0
        if above is wanted:
            return height_m
        if HeightAbove.GROUND in (above, wanted):
            message = f"its height counts from {above}, those of others from {wanted}: the ground's height is unknown"
            self._refuse(item, number, message, "use one kind of height in the whole plan")
            return None
        if self._home is None:
            message = f"its height counts from {above}, those of others from {wanted}: the altitude of home is unknown"
            self._refuse(item, number, message, "give the plan a home, or use one kind of height in it")
            return None
        return height_m - self._home[2] if above is HeightAbove.SEA else height_m + self._home[2]

    def _fly_to(self, item: MavItem, number: int) -> None:
        position = self._position(item, number)
        if position is None:
            return
        heading = self._begin_region_of_interest or self._heading_of(item)
        if heading != self._flown_heading:
            self._end_flight(number)
        self._flown_heading = heading
        self._waypoints.append(position)
        self._numbers.append(number)

    def _heading_of(self, item: MavItem) -> Any:
        yaw_deg = item.params[3]
        means_nothing = yaw_deg == 0.0 and (
            self._plan.firmware_type == _ARDUPILOT or self._plan.is_from_waypoints or self._departs == "drive_off"
        )
        return "along" if yaw_deg is None or means_nothing else (yaw_deg + 180.0) % 360.0 - 180.0

    def _take_off(self, item: MavItem, number: int) -> None:
        if self._departs != "take_off":
            self._warn(number, f"{_called(item, number)}, is left out: the vehicle departs in its own way")
            return
        above = _above(item) or HeightAbove.HOME
        height_m = item.z or 0.0
        if above is HeightAbove.SEA:
            if self._home is None:
                hint = "give the plan a home, or the take-off a height above home"
                self._refuse(item, number, "its height is above sea level, and the planned home is unknown", hint)
                return
            height_m -= self._home[2]
        if height_m <= 0.0:
            self._refuse(item, number, f"a take-off to {height_m:g} m", "give it a height above home")
            return
        self._end_flight(number)
        self._add("take_off", "take_off", {"height_m": round(height_m, 3)}, number)
        if item.has_position and self._home is not None and _distance_m(self._home, item) >= NEAR_M:
            self._fly_to(item, number)
        elif item.has_position:
            self._place = (item.x or 0.0, item.y or 0.0)

    def _waypoint(self, item: MavItem, number: int) -> None:
        self._fly_to(item, number)
        self._hold(item.params[0] or 0.0, number)

    def _loiter_time(self, item: MavItem, number: int) -> None:
        self._fly_to(item, number)
        self._hold(item.params[0] or 0.0, number)

    def _delay(self, item: MavItem, number: int) -> None:
        if (item.params[0] or 0.0) < 0.0:
            self._refuse(item, number, "a delay until a time of day cannot be expressed")
        self._hold(item.params[0] or 0.0, number)

    def _hold(self, duration_s: float, number: int) -> None:
        if duration_s > 0.0:
            self._end_flight(number)
            self._add("stay", "hold", {"duration_s": duration_s}, number)

    def _return(self, item: MavItem, number: int) -> None:
        del item
        self._end_flight(number)
        self._add("home", "return_home", {}, number)
        self._add("land", "land", {}, number)

    def _land(self, item: MavItem, number: int) -> None:
        self._end_flight(number)
        self._add("land", "land", {"at": [item.x, item.y]} if item.has_position else {}, number)

    def _speed(self, item: MavItem, number: int) -> None:
        speed_m_s = item.params[1]
        if speed_m_s is not None and speed_m_s > 0.0:
            self._end_flight(number)
            self._speed_m_s = speed_m_s

    def _convert_region_of_interest(self, item: MavItem, number: int) -> None:
        position = self._position(item, number) if item.has_position else None
        self._begin_region_of_interest = {"look_at": position} if position is not None else None

    def _end_region_of_interest(self, item: MavItem, number: int) -> None:
        del item, number
        self._begin_region_of_interest = None

    def _limited(self, number: int) -> float:
        """The speed to fly with, no faster than the platform."""
        if self._limit_m_s is None or self._speed_m_s <= self._limit_m_s:
            return self._speed_m_s
        del number
        self._warn(0, f"{self._speed_m_s:g} m/s is reduced to the platform's {self._limit_m_s:g} m/s")
        self._speed_m_s = self._limit_m_s
        return self._speed_m_s


Handler = Callable[[_Converter, MavItem, int], None]

_HANDLERS: Final[dict[int, Handler]] = {
    16: _Converter._waypoint,
    19: _Converter._loiter_time,
    20: _Converter._return,
    21: _Converter._land,
    22: _Converter._take_off,
    93: _Converter._delay,
    178: _Converter._speed,
    195: _Converter._convert_region_of_interest,
    197: _Converter._end_region_of_interest,
    201: _Converter._convert_region_of_interest,
}
"""By MAV_CMD: waypoint, loiter for a time, return, land, take-off, delay, speed, region of interest."""
CONVERTED: Final = frozenset(_HANDLERS)
"""The commands that become actions of a mission, or change how those behind them are flown."""
_TAKE_OFFS: Final = frozenset({22})
_MOVING: Final = frozenset({16, 19, 20, 21, 22, 93})


def geofence_of(fence: tuple[FenceArea, ...], file: str, findings: list[Finding]) -> dict[str, Any]:
    """The fence of a plan as written in a mission; what it cannot express is a finding."""
    inside = [area for area in fence if area.is_inclusion]
    if len(inside) > 1:
        message, hint = f"{len(inside)} inclusion areas", "a mission has one; merge them"
        findings.append(Finding(file=file, message=message, hint=hint))
    found: dict[str, Any] = _area(inside[0]) if inside else {}
    outside = [_area(area) for area in fence if not area.is_inclusion]
    if outside:
        found["keep_out"] = outside
    if outside and not inside:
        found["ceiling_m"] = 10_000.0
    return found


def _area(area: FenceArea) -> dict[str, Any]:
    if area.center is not None:
        return {"circle": {"center": list(area.center), "radius_m": area.radius_m}}
    return {"polygon": [list(corner) for corner in area.polygon]}


def _called(item: MavItem, number: int) -> str:
    """An item for people: its number in the plan, where home is item 0, and its command."""
    return f"item {number}, {command_name(item.command)}"


def _above(item: MavItem) -> HeightAbove | None:
    return _HEIGHT_ABOVE.get(item.frame)


def _common_reference(items: tuple[MavItem, ...]) -> HeightAbove | None:
    """What the heights of the first item that flies somewhere count from; None without any."""
    return next((_above(item) for item in items if item.command in _PLACED and _above(item) is not None), None)


_PLACED: Final = frozenset({16, 19})


def _distance_m(home: tuple[float, float, float], item: MavItem) -> float:
    """Distance over ground, good enough near home."""
    north = ((item.x or 0.0) - home[0]) * _METRES_PER_DEGREE
    east = ((item.y or 0.0) - home[1]) * _METRES_PER_DEGREE * cos(radians(home[0]))
    return hypot(north, east)
