"""Converts another program's plan to a mission of GLOC3, and reports what cannot be expressed."""

from collections.abc import Callable
from math import cos, hypot, radians
from typing import Any, Final

from gloc3.documents.document import dump
from gloc3.errors import Finding, InputError
from gloc3.mission.formats.items import MULTIROTORS, FenceArea, ForeignPlan, MavItem
from gloc3.mission.model.placement import HeightAbove

DEFAULT_SPEED_M_S: Final = 5.0
"""Of a plan that says nothing of speed."""
NEAR_M: Final = 1.0
"""A take-off position so near to the planned home is home."""

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


def to_mission(
    plan: ForeignPlan, name: str, file: str, speed_limit_m_s: float | None = None
) -> tuple[str, list[Finding]]:
    """Converts a plan to the text of a mission with the same path.

    Args:
        plan: the plan.
        name: of the mission.
        file: name of the plan in findings.
        speed_limit_m_s: the platform's; faster parts are flown at this speed.

    Returns:
        The YAML, and warnings about parts that were left out or changed.

    Raises:
        InputError: an item that moves or limits the vehicle cannot be expressed.
    """
    return _Converter(plan, name, file, speed_limit_m_s).mission()


class _Converter:
    """Goes through the items in their order."""

    def __init__(self, plan: ForeignPlan, name: str, file: str, speed_limit_m_s: float | None) -> None:
        self._plan, self._name, self._file = plan, name, file
        self._limit_m_s = speed_limit_m_s
        self._findings: list[Finding] = []
        self._actions: dict[str, dict[str, Any]] = {}
        self._waypoints: list[list[float]] = []
        self._heading: Any = "along"
        self._flown_heading: Any = "along"
        self._begin_region_of_interest: dict[str, Any] | None = None
        self._height_above: HeightAbove | None = None
        is_hovering = plan.vehicle_type is None or plan.vehicle_type in MULTIROTORS
        speed_m_s = plan.hover_speed_m_s if is_hovering else plan.cruise_speed_m_s
        self._speed_m_s = speed_m_s or DEFAULT_SPEED_M_S
        self._home = plan.home if plan.home is not None and any(plan.home[:2]) else None

    def mission(self) -> tuple[str, list[Finding]]:
        items = list(enumerate(self._plan.items, start=1))
        if self._plan.raw is None and _begins_with_home(self._plan.items):
            home = items.pop(0)[1]
            self._home = (home.x or 0.0, home.y or 0.0, home.z or 0.0)
        for number, item in items:
            handler = _HANDLERS.get(item.command)
            if handler is not None:
                handler(self, item, number)
            elif item.command in LEFT_OUT:
                self._warn(f"item {number}, {LEFT_OUT[item.command]}, is left out", "add record_images by hand")
            else:
                self._refuse(number, f"command {item.command} cannot be expressed in a mission")
        self._end_flight()
        if not self._actions:
            self._findings.append(Finding(file=self._file, message="it has no item that moves the vehicle"))
        written: dict[str, Any] = {"mission": self._name, "frame": "geo"}
        if self._height_above not in (None, HeightAbove.HOME):
            written["height_above"] = str(self._height_above)
        geofence = self._geofence()
        if geofence:
            written["geofence"] = geofence
        if self._plan.rally:
            self._warn("the rally points are left out", "the mission returns to its home")
        if any(not finding.is_warning for finding in self._findings):
            raise InputError(sorted(self._findings))
        return dump(written | {"tasks": {"fly": {"actions": self._actions}}}), self._findings

    def _warn(self, message: str, hint: str = "") -> None:
        self._findings.append(Finding(file=self._file, message=message, hint=hint, is_warning=True))

    def _refuse(self, number: int, message: str, hint: str = "take it out of the plan") -> None:
        self._findings.append(Finding(file=self._file, message=f"item {number}: {message}", hint=hint))

    def _add(self, name: str, capability: str, arguments: dict[str, Any]) -> None:
        previous = list(self._actions)[-1:]
        count = sum(key == name or key.startswith(name + "_") for key in self._actions)
        action: dict[str, Any] = {capability: arguments}
        if previous:
            action["after"] = previous
        self._actions[f"{name}_{count + 1}" if count else name] = action

    def _end_flight(self) -> None:
        """Makes one action of the waypoints so far."""
        if self._waypoints:
            arguments: dict[str, Any] = {"waypoints": self._waypoints, "speed_m_s": self._limited()}
            if self._flown_heading != "along":
                arguments["heading"] = self._flown_heading
            self._add("way", "follow_waypoints", arguments)
            self._waypoints = []

    def _position(self, item: MavItem, number: int) -> list[float] | None:
        """The place of an item, the same heights for all; None where it has none."""
        if not item.x and not item.y:
            return None
        above = _HEIGHT_ABOVE.get(item.frame)
        if above is None:
            self._refuse(number, f"frame {item.frame} of its position cannot be expressed", "use a global frame")
            return None
        if self._height_above not in (None, above):
            message = f"its height counts from {above}, those before from {self._height_above}"
            self._refuse(number, message, "use one kind of height in the whole plan")
        self._height_above = above
        return [item.x or 0.0, item.y or 0.0, item.z or 0.0]

    def _fly_to(self, item: MavItem, number: int) -> None:
        position = self._position(item, number)
        if position is None:
            return
        heading = self._begin_region_of_interest or self._heading_of(item)
        if heading != self._flown_heading:
            self._end_flight()
        self._flown_heading = heading
        self._waypoints.append(position)

    def _heading_of(self, item: MavItem) -> Any:
        yaw_deg = item.params[3]
        means_nothing = yaw_deg == 0.0 and (self._plan.firmware_type == _ARDUPILOT or self._plan.raw is None)
        return "along" if yaw_deg is None or means_nothing else (yaw_deg + 180.0) % 360.0 - 180.0

    def _take_off(self, item: MavItem, number: int) -> None:
        above = _HEIGHT_ABOVE.get(item.frame, HeightAbove.HOME)
        height_m = item.z or 0.0
        if above is HeightAbove.SEA:
            if self._home is None:
                self._refuse(number, "its height is above sea level, and the planned home is unknown")
                return
            height_m -= self._home[2]
        if height_m <= 0.0:
            self._refuse(number, f"a take-off to {height_m:g} m", "give it a height above home")
            return
        self._end_flight()
        self._add("take_off", "take_off", {"height_m": height_m})
        if (item.x or item.y) and self._home is not None and _distance_m(self._home, item) >= NEAR_M:
            self._fly_to(item, number)

    def _waypoint(self, item: MavItem, number: int) -> None:
        self._fly_to(item, number)
        self._hold(item.params[0] or 0.0)

    def _loiter_time(self, item: MavItem, number: int) -> None:
        self._fly_to(item, number)
        self._hold(item.params[0] or 0.0)

    def _delay(self, item: MavItem, number: int) -> None:
        if (item.params[0] or 0.0) < 0.0:
            self._refuse(number, "a delay until a time of day cannot be expressed")
        self._hold(item.params[0] or 0.0)

    def _hold(self, duration_s: float) -> None:
        if duration_s > 0.0:
            self._end_flight()
            self._add("stay", "hold", {"duration_s": duration_s})

    def _return(self, item: MavItem, number: int) -> None:
        del item, number
        self._end_flight()
        self._add("home", "return_home", {})
        self._add("land", "land", {})

    def _land(self, item: MavItem, number: int) -> None:
        del number
        self._end_flight()
        self._add("land", "land", {"at": [item.x, item.y]} if item.x or item.y else {})

    def _speed(self, item: MavItem, number: int) -> None:
        del number
        speed_m_s = item.params[1]
        if speed_m_s is not None and speed_m_s > 0.0:
            self._end_flight()
            self._speed_m_s = speed_m_s

    def _convert_region_of_interest(self, item: MavItem, number: int) -> None:
        position = self._position(item, number)
        self._begin_region_of_interest = {"look_at": position} if position is not None else None

    def _end_region_of_interest(self, item: MavItem, number: int) -> None:
        del item, number
        self._begin_region_of_interest = None

    def _geofence(self) -> dict[str, Any]:
        """The fence as written in a mission."""
        inside = [area for area in self._plan.fence if area.is_inclusion]
        if len(inside) > 1:
            self._findings.append(
                Finding(file=self._file, message=f"{len(inside)} inclusion areas", hint="a mission has one; merge them")
            )
        found: dict[str, Any] = _area(inside[0]) if inside else {}
        outside = [_area(area) for area in self._plan.fence if not area.is_inclusion]
        if outside:
            found["keep_out"] = outside
        if outside and not inside:
            found["ceiling_m"] = 10_000.0
        return found

    def _limited(self) -> float:
        """The speed to fly with, no faster than the platform."""
        if self._limit_m_s is None or self._speed_m_s <= self._limit_m_s:
            return self._speed_m_s
        self._warn(f"{self._speed_m_s:g} m/s is reduced to the platform's {self._limit_m_s:g} m/s")
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


def _begins_with_home(items: tuple[MavItem, ...]) -> bool:
    """Whether the first item is home, as in most files of waypoints: above the sea, and the others are not."""
    return len(items) > 1 and (items[0].command, items[0].frame) == (16, 0) and any(i.frame != 0 for i in items[1:])


def _area(area: FenceArea) -> dict[str, Any]:
    if area.center is not None:
        return {"circle": {"center": list(area.center), "radius_m": area.radius_m}}
    return {"polygon": [list(corner) for corner in area.polygon]}


def _distance_m(home: tuple[float, float, float], item: MavItem) -> float:
    """Distance over ground, good enough near home."""
    north = ((item.x or 0.0) - home[0]) * _METRES_PER_DEGREE
    east = ((item.y or 0.0) - home[1]) * _METRES_PER_DEGREE * cos(radians(home[0]))
    return hypot(north, east)
