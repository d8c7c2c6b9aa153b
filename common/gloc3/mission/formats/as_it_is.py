"""Plans of other programs that the autopilot flies as they are: the order that carries them, and their path.

The items go to the autopilot unchanged. The path is for the checks and the estimate: jumps are followed, splines are
straight, and what is not known before (a loiter until a height, a circle) counts as a stay.
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

import msgspec

from gloc3.messages.frames import GeoPoint, Vector3
from gloc3.mission.formats.commands import (
    CHANGE_SPEED,
    COMMANDS,
    DELAY,
    DO_JUMP_TAG,
    JUMP,
    JUMP_TAG,
    LAND,
    LOITER_TIME,
    LOITER_UNLIMITED,
    RETURN,
    SPLINE,
    TAKE_OFF,
    VTOL_LAND,
    VTOL_TAKE_OFF,
    WAYPOINT,
    command_name,
)
from gloc3.mission.formats.items import ForeignPlan, MavItem
from gloc3.mission.model.arguments import Arguments
from gloc3.mission.model.legs import Budget, FlightLeg, fly
from gloc3.mission.model.placement import GeoPlacement, HeightAbove

MOST_STEPS: Final = 10_000
"""Items that are followed, jumps included."""
GROUND_FRAMES: Final = (10, 11)
"""MAV_FRAMEs whose heights are above the ground."""
_ABOVE: Final = {0: HeightAbove.SEA, 5: HeightAbove.SEA}
_TAKE_OFFS: Final = (TAKE_OFF, VTOL_TAKE_OFF)
_LANDINGS: Final = (LAND, VTOL_LAND, RETURN)
_STAYS: Final = (WAYPOINT, SPLINE, LOITER_TIME, DELAY)
"""Commands whose first parameter is a time in seconds."""


class PlanPlace(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A place of the path."""

    position_ned_m: Vector3 | None = None
    """None for home."""
    lat_lon: tuple[float, float] | None = None
    """As written, degrees; None for home, and where it stays at the place before."""
    name: str
    """For people, as `item 3, NAV_WAYPOINT, line 5 of field.waypoints`."""
    stay_s: float = 0.0
    speed_m_s: float = 0.0
    """0 for the platform's."""


class FlyFileOrder(Arguments, frozen=True, kw_only=True):
    """Have the autopilot fly the items of a plan, unchanged."""

    moves = True

    file: str = ""
    """Name of the plan."""
    items: tuple[MavItem, ...]
    """Without home, numbered from 1."""
    home: tuple[float, float, float] | None = None
    path: tuple[PlanPlace, ...] = ()
    sets_off: bool = False
    """Whether it begins on the ground, which includes arming."""
    may_arm: bool = False
    """Whether the vehicle may be armed for it: the platform file's `arm`."""
    comes_down: bool = False
    """Whether it ends on the ground, or in the autopilot's return."""
    last_item: int = 0
    """Number of the item with which it ends: those behind a landing or a return are not reached."""
    never_ends: str = ""
    """The item that never ends, for people; empty where each does."""

    @property
    def first_place(self) -> GeoPoint | None:
        """The planned home, or the first position at sea level; None without any."""
        if self.home is not None and any(self.home[:2]):
            return GeoPoint(*self.home)
        return next((GeoPoint(item.x or 0.0, item.y or 0.0, 0.0) for item in self.items if item.has_position), None)

    @property
    def follows_ground(self) -> bool:
        """Whether it has heights above the ground, which the autopilot keeps by its own terrain data."""
        return any(_moves(item) and item.frame in GROUND_FRAMES for item in self.items)

    @property
    def begins_flight(self) -> bool:
        """Whether it takes off, or drives off."""
        return self.sets_off

    @property
    def begins_with(self) -> str:
        """The first item that moves the vehicle, with its line."""
        return self.path[0].name if self.path else ""

    @property
    def ends_flight(self) -> bool:
        """Whether it lands."""
        return self.comes_down

    def legs(self, start_ned_m: Vector3, budget: Budget) -> tuple[FlightLeg, ...]:
        """Straight from place to place, each at the speed that the plan or the platform states."""
        legs: list[FlightLeg] = []
        here = start_ned_m
        if self.sets_off:
            legs.append(FlightLeg(start=here, end=here, duration_s=budget.arming_s))
        for index, place in enumerate(self.path):
            home = (budget.home_ned_m[0], budget.home_ned_m[1], here[2])
            to = place.position_ned_m if place.position_ned_m is not None else home
            speed_m_s = min(place.speed_m_s or budget.speed_m_s, budget.speed_m_s)
            pieces = fly(here, [to], speed_m_s, place.stay_s, budget)
            legs += [msgspec.structs.replace(leg, waypoint=index) for leg in pieces]
            here = to
        if self.comes_down:
            ground = (here[0], here[1], budget.home_ned_m[2])
            down_s = abs(ground[2] - here[2]) / budget.landing_m_s + budget.disarming_s
            legs.append(FlightLeg(start=here, end=ground, duration_s=down_s))
        return tuple(legs)


class PlanVehicle(NamedTuple):
    """What must be known of the vehicle that flies a plan."""

    arm: bool = False
    """Whether a mission may arm it."""
    stays_down: bool = False
    """Whether it needs no take-off, as what drives or dives."""
    is_level: bool = False
    """Whether its autopilot ignores heights, as what drives."""
    circles_home: bool = False
    """Whether its return ends in a circle round home, as on wings without rotors."""


def file_order(
    plan: ForeignPlan, file: str, origin: GeoPoint, home_altitude_m: float | None, vehicle: PlanVehicle
) -> FlyFileOrder:
    """The order for a plan.

    Args:
        plan: that was read.
        file: its name for people.
        origin: of NED.
        home_altitude_m: of home above the sea; None for that of the origin.
        vehicle: that flies it.
    """
    steps = _Steps(plan, file, vehicle)
    placements = {above: GeoPlacement(origin, above, home_altitude_m) for above in (HeightAbove.HOME, HeightAbove.SEA)}
    path = tuple(steps.places(placements))
    first = next((item for item in plan.items if _moves(item)), None)
    takes_off = first is not None and first.command in _TAKE_OFFS
    return FlyFileOrder(
        file=file,
        items=plan.items,
        home=plan.home,
        path=path,
        sets_off=takes_off or (vehicle.stays_down and first is not None),
        may_arm=vehicle.arm,
        comes_down=steps.comes_down and not (vehicle.stays_down or steps.never_ends),
        last_item=steps.last_item,
        never_ends=steps.never_ends,
    )


def _moves(item: MavItem) -> bool:
    command = COMMANDS.get(item.command)
    return (command is not None and command.goes_to) or item.command == RETURN


class _Steps:
    """Follows the items of a plan as an autopilot does."""

    def __init__(self, plan: ForeignPlan, file: str, vehicle: PlanVehicle) -> None:
        self._plan, self._file, self._vehicle = plan, file, vehicle
        self.comes_down = False
        self.last_item = 0
        self.never_ends = ""

    def places(self, placements: dict[HeightAbove, GeoPlacement]) -> Iterator[PlanPlace]:
        """The places in the order in which they are flown to."""
        speed_m_s = 0.0
        last: Vector3 | None = None
        here = self._plan.home[:2] if self._plan.home is not None else None
        for number, item in self._in_order():
            command = COMMANDS.get(item.command)
            stay_s = max(0.0, item.params[0] or 0.0) if item.command in _STAYS else 0.0
            name = self._name(number, item)
            if item.command == CHANGE_SPEED:
                speed_m_s = max(0.0, item.params[1] or 0.0)
            elif item.command == RETURN:
                yield PlanPlace(name=name, speed_m_s=speed_m_s)
            elif command is not None and command.goes_to and (item.has_position or here is not None):
                here = (item.x or 0.0, item.y or 0.0) if item.has_position and item.command not in _TAKE_OFFS else here
                place = here or (item.x or 0.0, item.y or 0.0)
                above = HeightAbove.HOME if self._vehicle.is_level else _ABOVE.get(item.frame, HeightAbove.HOME)
                there = placements[above].ned_from((*place, 0.0 if self._vehicle.is_level else item.z or 0.0))
                is_level = item.command in _LANDINGS and last is not None  # it comes down afterwards
                last = (there[0], there[1], last[2]) if is_level and last is not None else there
                written = (item.x or 0.0, item.y or 0.0) if item.has_position else None
                yield PlanPlace(position_ned_m=last, lat_lon=written, name=name, stay_s=stay_s, speed_m_s=speed_m_s)
            elif stay_s and last is not None:
                yield PlanPlace(position_ned_m=last, name=name, stay_s=stay_s, speed_m_s=speed_m_s)

    def _in_order(self) -> Iterator[tuple[int, MavItem]]:
        items, index = self._plan.items, 0
        jumped: dict[int, int] = {}
        tags = {int(item.params[0] or 0): at for at, item in enumerate(items) if item.command == JUMP_TAG}
        for _ in range(MOST_STEPS):
            if index >= len(items):
                return
            item = items[index]
            if item.command in (JUMP, DO_JUMP_TAG):
                target, times = int(item.params[0] or 0), int(item.params[1] or 0)
                to = target - 1 if item.command == JUMP else tags.get(target, index + 1)
                if times < 0:
                    self.never_ends = self._name(index + 1, item)
                    return
                if jumped.setdefault(index, 0) < times and 0 <= to < len(items):
                    jumped[index] += 1
                    index = to
                    continue
                jumped.pop(index)
            else:
                yield index + 1, item
            if _moves(item) or item.command == DELAY:
                self.last_item = index + 1
            self.comes_down = item.command in _LANDINGS or (self.comes_down and not _moves(item))
            if item.command == LOITER_UNLIMITED or (item.command == RETURN and self._vehicle.circles_home):
                self.never_ends = self._name(index + 1, item)
                return
            if item.command in _LANDINGS:
                return
            index += 1
        self.never_ends = self._name(index + 1, items[min(index, len(items) - 1)])

    def _name(self, number: int, item: MavItem) -> str:
        line = self._plan.line_of(number)
        return f"item {number}, {command_name(item.command)}" + (f", line {line} of {self._file}" if line else "")
