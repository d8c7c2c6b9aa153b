"""The modes of a VTOL: one behaviour on rotors, another on wings, and straight ahead between the two."""

from collections.abc import Callable
from math import atan2, hypot, nan
from typing import Final

from gloc3.messages.frames import Vector3, wrap_pi
from gloc3_sitl.autopilot.behaviours.base import Activity, FliesMission, GoesTo, TakesOff
from gloc3_sitl.autopilot.behaviours.flight_path import PlanePath
from gloc3_sitl.autopilot.behaviours.hold import HoldPosition
from gloc3_sitl.autopilot.behaviours.land import LandInPlace
from gloc3_sitl.autopilot.behaviours.mission import MissionFlight
from gloc3_sitl.autopilot.behaviours.piloted import Altitude, Position, Stabilize
from gloc3_sitl.autopilot.behaviours.return_home import ReturnFlight, nearest_goal
from gloc3_sitl.autopilot.behaviours.streamed import Guided, Offboard
from gloc3_sitl.autopilot.behaviours.winged import BySticks, CircleLoiter, Cruise, MissionOnWings, ReturnToCircle
from gloc3_sitl.autopilot.control.setpoint import Setpoint
from gloc3_sitl.autopilot.control.vtol_form import VtolForm, VtolState
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.plans import LANDINGS, TAKE_OFFS, MissionCommand, StoredItem

_MOVES_M_S: Final = 3.0
"""Slower than this the nose says where ahead is, faster the course."""
_TURNED_RAD: Final = 0.1
_WINGS: Final = 4.0
"""Parameter of a transition item."""

MakeActivity = Callable[[Craft], Activity]


def state_of(craft: Craft) -> VtolState:
    """The form of a VTOL."""
    assert craft.vtol is not None
    return craft.vtol


def speed_m_s(craft: Craft) -> float:
    """Over ground, on the map."""
    vn, ve, _ = craft.estimator.inertial.velocity_ned_m_s
    return hypot(vn, ve)


class StraightOn(Activity):
    """A transition: keeps course and height."""

    __slots__ = ("_course_rad", "_down_m", "_path")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        vn, ve, _ = craft.estimator.inertial.velocity_ned_m_s
        self._path = PlanePath(craft)
        self._course_rad = atan2(ve, vn) if hypot(vn, ve) > _MOVES_M_S else craft.estimator.yaw_rad
        self._down_m = craft.estimator.inertial.position_ned_m[2]

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped; the height jumps with it."""
        self._down_m += jump_ned_m[2]

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        return self._path.on_course(self._course_rad, self._down_m)


class TurnOnTheSpot(HoldPosition):
    """Hovers and turns its nose: before PX4 goes over to wings."""

    __slots__ = ()

    def __init__(self, craft: Craft, course_rad: float) -> None:
        super().__init__(craft)
        self.yaw_wanted_rad = course_rad

    @property
    def is_turned(self) -> bool:
        """Whether the nose points there."""
        return abs(wrap_pi(self.yaw_wanted_rad - self.craft.estimator.yaw_rad)) < _TURNED_RAD


class TwoForms(Activity):
    """Flies one activity on rotors, another on wings, each made when its form begins.

    Args:
        craft: the vehicle.
        on_rotors: makes the one.
        on_wings: makes the other.
        wings: the form to which it goes over; None keeps the one that there is.
    """

    __slots__ = ("_make", "active", "form", "is_done", "state")

    def __init__(
        self, craft: Craft, on_rotors: MakeActivity, on_wings: MakeActivity, *, wings: bool | None = None
    ) -> None:
        super().__init__(craft)
        self.is_done = False
        self.state: Final = state_of(craft)
        self._make: Final = {VtolForm.ROTORS: on_rotors, VtolForm.WINGS: on_wings}
        if wings is not None and not craft.is_landed:
            self.state.want(wings=wings)
        self.form = self.state.form
        self.active: Activity = self.make()

    def make(self) -> Activity:
        """What is flown in the present form."""
        return self._make.get(self.form, StraightOn)(self.craft)

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped."""
        self.active.on_jump(jump_ned_m)

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        if self.state.form is not self.form:
            self.form = self.state.form
            self.active = self.make()
        setpoint = self.active.update()
        self.is_done = self.active.is_done
        return setpoint


class VtolHold(TwoForms, GoesTo):
    """Hovers on rotors and circles on wings, here or where it is sent."""

    __slots__ = ()

    def __init__(self, craft: Craft, *, wings: bool | None = None) -> None:
        super().__init__(craft, HoldPosition, CircleLoiter, wings=wings)

    def go_to(self, position_ned_m: Vector3, yaw_rad: float = nan, speed_m_s: float = nan) -> None:
        """Flies to a place."""
        if isinstance(self.active, GoesTo):
            self.active.go_to(position_ned_m, yaw_rad, speed_m_s)


class VtolGuided(TwoForms, GoesTo, TakesOff):
    """ArduPilot's Guided: hovers on rotors, or with `Q_GUIDED_MODE` 0 circles on wings."""

    __slots__ = ("_target",)

    def __init__(self, craft: Craft) -> None:
        self._target: tuple[Vector3, float] | None = None
        super().__init__(craft, Guided, CircleLoiter, wings=not craft.tuning.vtol.guided_hovers)
        self.state.seem_to_leave_rotors(craft.now_s)

    def make(self) -> Activity:
        """Goes on to where it was sent."""
        active = super().make()
        if self._target is not None and isinstance(active, GoesTo):
            active.go_to(*self._target)
        return active

    def go_to(self, position_ned_m: Vector3, yaw_rad: float = nan, speed_m_s: float = nan) -> None:
        """Flies to a place."""
        del speed_m_s
        self._target = position_ned_m, yaw_rad
        if isinstance(self.active, GoesTo):
            self.active.go_to(position_ned_m, yaw_rad)

    def take_off(self, target_down_m: float) -> None:
        """Climbs on rotors."""
        if isinstance(self.active, TakesOff):
            self.active.take_off(target_down_m)


class WayHome(Activity):
    """Return on wings: to home at the height of returns, until it can stop there."""

    __slots__ = ("_goal", "_path")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        n, e, ground = nearest_goal(craft)
        self._path = PlanePath(craft)
        self._goal = (n, e, ground - max(craft.height_over_home_m, craft.tuning.wings.return_height_m))
        self._path.head_for(self._goal)

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft = self.craft
        if self._path.distance_m(self._goal) < craft.tuning.vtol.stopping_m(speed_m_s(craft)):
            state_of(craft).want(wings=False)
        return self._path.follow()


def hold(craft: Craft) -> Activity:
    """PX4's Hold."""
    return VtolHold(craft)


def loiter(craft: Craft) -> Activity:
    """ArduPilot's Loiter: on wings."""
    return VtolHold(craft, wings=True)


def return_home(craft: Craft) -> Activity:
    """Back in the form that it flies in, and down on rotors; with `Q_RTL_MODE` 0 to a circle on wings."""
    if craft.tuning.vtol.return_lands:
        return TwoForms(craft, ReturnFlight, WayHome)
    return TwoForms(craft, HoldPosition, ReturnToCircle, wings=True)


def return_on_rotors(craft: Craft) -> Activity:
    """ArduPilot's QRTL."""
    return TwoForms(craft, ReturnFlight, StraightOn, wings=False)


def land(craft: Craft) -> Activity:
    """Down on rotors where it comes to a hover."""
    return TwoForms(craft, LandInPlace, StraightOn, wings=False)


def stabilize(craft: Craft) -> Activity:
    """PX4's Stabilized."""
    return TwoForms(craft, Stabilize, BySticks)


def altitude(craft: Craft) -> Activity:
    """PX4's Altitude."""
    return TwoForms(craft, Altitude, Cruise)


def position(craft: Craft) -> Activity:
    """PX4's Position."""
    return TwoForms(craft, Position, Cruise)


def offboard(craft: Craft) -> Activity:
    """PX4's Offboard; on wings it circles."""
    return TwoForms(craft, Offboard, CircleLoiter)


class MissionPartOnWings(MissionOnWings):
    """The items that are flown on wings; it lands on rotors."""

    __slots__ = ()

    def _start(self, item: StoredItem) -> None:
        if item.command in LANDINGS:
            n, e, _ = self._place(item)
            self._head_for((n, e, self.craft.estimator.inertial.position_ned_m[2]), item)
        elif item.command is MissionCommand.RETURN:
            self._sub = WayHome(self.craft)
        else:
            super()._start(item)

    def _is_reached(self, item: StoredItem) -> bool:
        if item.command not in LANDINGS:
            return super()._is_reached(item)
        if self.horizontal_distance_to(self.trajectory.target) < self.craft.tuning.vtol.stopping_m(
            speed_m_s(self.craft)
        ):
            state_of(self.craft).want(wings=False)
        return False


class VtolMission(TwoForms, FliesMission):
    """PX4's Mission: transitions are items, and between them the form stays.

    A part of the mission in one form is a flight of its own; it goes on at the current item.
    """

    __slots__ = ()

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft, MissionFlight, MissionPartOnWings)

    @property
    def _item(self) -> StoredItem | None:
        progress, items = self.craft.mission, self.craft.plans.mission
        return items[progress.current] if progress.current < len(items) and not self.is_done else None

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        progress, item = self.craft.mission, self._item
        is_paused = progress.is_paused
        if item is not None and self.craft.is_armed and not is_paused:
            self._choose_form(item)
        setpoint = super().update()
        if is_paused and not progress.is_paused:
            self.pause()  # a part that begins would go on
        return setpoint

    def _choose_form(self, item: StoredItem) -> None:
        if item.command == MissionCommand.VTOL_TRANSITION:
            if item.parameters[0] == _WINGS and self.form is VtolForm.ROTORS and self._turns():
                return
            self.state.want(wings=item.parameters[0] == _WINGS)
            if self.state.is_settled or self.state.problem or self.craft.is_landed:
                self._pass_item()
        elif item.command == MissionCommand.VTOL_TAKE_OFF and self._has_climbed(item):
            self.state.want(wings=True)
            if self.state.is_settled:
                self._pass_item()

    def _turns(self) -> bool:
        """Turns its nose to the next place before the transition; false once it points there."""
        if self.state.wants_wings or self.state.problem or self.craft.is_landed:
            return False
        if not isinstance(self.active, TurnOnTheSpot):
            n, e, _ = self.craft.estimator.inertial.position_ned_m
            place = self._next_place()
            if place is None or hypot(place[0] - n, place[1] - e) < 1.0:
                return False
            self.active = TurnOnTheSpot(self.craft, atan2(place[1] - e, place[0] - n))
        return not self.active.is_turned

    def _next_place(self) -> tuple[float, float] | None:
        """Of the first item from the current one on that has one, north and east."""
        origin, progress = self.craft.estimator.origin, self.craft.mission
        for item in self.craft.plans.mission[progress.current :]:
            if origin is not None and item.has_place:
                n, e, _ = origin.ned_from_geo(item.latitude_deg, item.longitude_deg, origin.origin.altitude_m)
                return n, e
        return None

    def _has_climbed(self, item: StoredItem) -> bool:
        home = self.craft.home
        base_m = 0.0 if item.is_relative or home is None else home.place.altitude_m
        return not self.craft.is_landed and self.craft.height_over_home_m > item.height_m - base_m - 1.0

    def _pass_item(self) -> None:
        progress = self.craft.mission
        progress.reached.append(progress.current)
        progress.current += 1
        self.active = self.make()

    def skip_to(self, index: int) -> None:
        """Makes another item the current one."""
        self.craft.mission.current = index
        self.is_done = False
        self.active = self.make()

    def pause(self) -> None:
        """Stops or circles here, inside the mode."""
        if isinstance(self.active, FliesMission):
            self.active.pause()
        self.craft.mission.is_paused = True

    def go_on(self) -> None:
        """Resumes after a pause."""
        self.craft.mission.is_paused = False
        self.active = self.make()


class QuadplaneMission(VtolMission):
    """ArduPilot's Auto: ways are flown on wings, take-offs and landings on rotors, and all on rotors after such a transition."""

    __slots__ = ("_stays_on_rotors",)

    def __init__(self, craft: Craft) -> None:
        self._stays_on_rotors = False
        super().__init__(craft)

    def make(self) -> Activity:
        """In a transition to wings it turns to its way already."""
        return MissionPartOnWings(self.craft) if self.form is VtolForm.TO_WINGS else super().make()

    def _choose_form(self, item: StoredItem) -> None:
        if item.command == MissionCommand.VTOL_TRANSITION:
            self._stays_on_rotors = item.parameters[0] != _WINGS
            self._pass_item()
        elif item.command in LANDINGS:
            pass  # on wings until it can stop there
        else:
            is_lifted = self._stays_on_rotors or item.command in TAKE_OFFS or self.craft.is_landed
            has_given_up = bool(self.state.problem) and self.craft.tuning.vtol.gives_up
            self.state.want(wings=not is_lifted and not has_given_up)
