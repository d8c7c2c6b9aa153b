"""The modes of a plane, as in ArduPilot's Plane; landings are in `touching_down.py`."""

from math import nan, pi
from typing import Final

from gloc3.messages.envelope import Severity
from gloc3.messages.frames import Vector3
from gloc3_sitl.autopilot.behaviours.base import PERIOD_S, Activity, GoesTo
from gloc3_sitl.autopilot.behaviours.flight_path import PlanePath, beyond, circle_of
from gloc3_sitl.autopilot.behaviours.mission import MissionFlight, holds
from gloc3_sitl.autopilot.behaviours.return_home import nearest_goal
from gloc3_sitl.autopilot.behaviours.touching_down import Descent
from gloc3_sitl.autopilot.control.setpoint import LANDED, Setpoint, WingSetpoint
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.plans import MissionCommand, StoredItem

_STICK_CLIMB_M_S: Final = 3.0
_HEIGHT_M: Final = 5.0
"""A height is reached so near."""
_CIRCLES: Final = frozenset(
    {
        MissionCommand.LOITER_UNLIMITED,
        MissionCommand.LOITER_TURNS,
        MissionCommand.LOITER_TIME,
        MissionCommand.LOITER_TO_HEIGHT,
    }
)


class ManualFlight(Activity):
    """Manual: the sticks are rudders and throttle."""

    __slots__ = ()

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        pilot = self.craft.pilot
        if not self.craft.is_armed:
            return LANDED
        if not pilot.is_on:
            return WingSetpoint(is_direct=True, throttle=0.0)
        return WingSetpoint(
            is_direct=True, throttle=pilot.throttle, aileron=pilot.roll, elevator=pilot.pitch, rudder=pilot.yaw
        )


class BySticks(Activity):
    """Stabilize and FBWA: the sticks are bank, nose and throttle; without a transmitter it glides level."""

    __slots__ = ()

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        pilot, gains = self.craft.pilot, self.craft.tuning.wings
        if not self.craft.is_armed:
            return LANDED
        if not pilot.is_on:
            return WingSetpoint(pitch_rad=0.0, throttle=0.0)
        most = gains.pitch_max_rad if pilot.pitch > 0.0 else -gains.pitch_min_rad
        return WingSetpoint(
            roll_rad=pilot.roll * gains.roll_max_rad, pitch_rad=pilot.pitch * most, throttle=pilot.throttle
        )


class Cruise(Activity):
    """Keeps course, height and speed; the sticks change them."""

    __slots__ = ("_course_rad", "_down_m", "_path")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self._path = PlanePath(craft)
        self._down_m = craft.estimator.inertial.position_ned_m[2]
        self._course_rad = craft.estimator.yaw_rad

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped; the height jumps with it."""
        self._down_m += jump_ned_m[2]

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft, gains = self.craft, self.craft.tuning.wings
        if not craft.is_armed or craft.is_landed:
            return LANDED
        pilot = craft.pilot
        if pilot.is_on and abs(pilot.pitch) > 0.06:
            self._down_m -= pilot.pitch * _STICK_CLIMB_M_S * PERIOD_S
        if pilot.is_on and abs(pilot.roll) > 0.06:
            self._course_rad = craft.estimator.yaw_rad
            return WingSetpoint(roll_rad=pilot.roll * gains.roll_max_rad, down_m=self._down_m)
        return self._path.on_course(self._course_rad, self._down_m)


class CircleFlight(Activity):
    """Circles with half of the largest bank, wherever that drifts; needs no position."""

    __slots__ = ("_down_m",)

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self._down_m = craft.estimator.inertial.position_ned_m[2]

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        if not self.craft.is_armed or self.craft.is_landed:
            return LANDED
        return WingSetpoint(roll_rad=0.5 * self.craft.tuning.wings.roll_max_rad, down_m=self._down_m)


class CircleLoiter(GoesTo):
    """Loiter and Guided: goes round a place, here to begin with, or wherever it is sent."""

    __slots__ = ("_centre", "_path")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self._path = PlanePath(craft)
        self._centre = craft.estimator.inertial.position_ned_m

    def go_to(self, position_ned_m: Vector3, yaw_rad: float = nan, speed_m_s: float = nan) -> None:
        """Flies to a place and goes round it."""
        del yaw_rad
        self._centre = position_ned_m
        self._path.airspeed_m_s = speed_m_s if speed_m_s > 0.0 else nan

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped: the position stays fixed on Earth."""
        del jump_ned_m

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        if not self.craft.is_armed or self.craft.is_landed:
            self._centre = self.craft.estimator.inertial.position_ned_m
            return LANDED
        return self._path.circle(self._centre, self.craft.tuning.wings.circle_m)


class ReturnToCircle(Activity):
    """RTL: back to home or the nearest rally point at the height of returns, and circles it until the mode changes."""

    __slots__ = ("_centre", "_path", "_radius_m", "is_done")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self.is_done = False
        gains = craft.tuning.wings
        self._path = PlanePath(craft)
        n, e, ground = nearest_goal(craft)
        here = craft.estimator.inertial.position_ned_m[2]
        self._centre = (n, e, here if gains.return_height_m < 0.0 else ground - gains.return_height_m)
        self._radius_m = gains.return_circle_m or gains.circle_m

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        if not self.craft.is_armed or self.craft.is_landed:
            return LANDED
        self.is_done = self._path.is_round(self._centre, self._radius_m)
        return self._path.circle(self._centre, self._radius_m)


class RunUp(Activity):
    """Take-off from the ground: full throttle along the runway, nose up, straight climb, then to the height."""

    __slots__ = ("_down_m", "_heading_rad", "_path", "_place", "_rotates", "is_done")

    def __init__(self, craft: Craft, down_m: float = nan) -> None:
        super().__init__(craft)
        self.is_done = False
        self._path = PlanePath(craft)
        self._down_m, self._place = down_m, craft.estimator.inertial.position_ned_m
        self._heading_rad = craft.estimator.yaw_rad
        self._rotates = False

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft, gains = self.craft, self.craft.tuning.wings
        here = craft.estimator.inertial.position_ned_m
        if not craft.is_armed:
            self._place, self._heading_rad = here, craft.estimator.yaw_rad
            self._rotates = self.is_done = False
            return LANDED
        target_down = self._place[2] - gains.takeoff_height_m if self._down_m != self._down_m else self._down_m
        far = beyond(self._place, self._heading_rad, gains.takeoff_ahead_m)
        if self.is_done:
            return self._path.circle((far[0], far[1], target_down), gains.circle_m)
        craft.runway_rad = self._heading_rad
        self.is_done = here[2] < target_down + 2.0
        speed = craft.airspeed_m_s
        if not self._rotates:
            self._rotates = speed > gains.takeoff_rotate_m_s
            return WingSetpoint(pitch_rad=0.0, throttle=gains.throttle_max, heading_rad=self._heading_rad)
        if self._place[2] - here[2] < gains.takeoff_level_m:
            return WingSetpoint(pitch_rad=gains.takeoff_pitch_rad, throttle=gains.throttle_max)
        return self._path.on_course(self._heading_rad, target_down)


class MissionOnWings(MissionFlight):
    """Auto: the items of the uploaded mission, along straight legs, with circles for waits."""

    __slots__ = ("_centre", "_line_start", "_path", "_radius_m")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self._path = PlanePath(craft)
        self._centre: Vector3 | None = craft.estimator.inertial.position_ned_m
        self._radius_m = craft.tuning.wings.circle_m
        self._line_start: Vector3 | None = None

    def pause(self) -> None:
        """Circles here, inside the mode."""
        super().pause()
        self._go_round(self.craft.estimator.inertial.position_ned_m, self.craft.tuning.wings.circle_m)

    def fly(self) -> Setpoint:
        """Along the line, or round the place where it is to wait."""
        if self._centre is not None:
            return self._path.circle(self._centre, self._radius_m)
        return self._path.follow()

    def _go_round(self, centre: Vector3, radius_m: float) -> None:
        self._centre, self._radius_m = centre, radius_m
        self.trajectory.go_to(centre)

    def _is_instant(self, item: StoredItem) -> bool:
        if item.command is MissionCommand.CHANGE_SPEED and item.parameters[1] > 0.0:
            gains = self.craft.tuning.wings
            self._path.airspeed_m_s = max(gains.slowest_m_s, min(gains.fastest_m_s, item.parameters[1]))
        return super()._is_instant(item)

    def _start(self, item: StoredItem) -> None:
        craft = self.craft
        match item.command:
            case MissionCommand.RETURN:
                self._sub = ReturnToCircle(craft)
            case MissionCommand.TAKE_OFF if craft.is_landed:
                self._sub = RunUp(craft, self._place(item)[2])
            case MissionCommand.LAND:
                self._sub = Descent(craft, self._place(item), self._line_start)
            case MissionCommand.DELAY | MissionCommand.CONDITION_DELAY:
                super()._start(item)
                self._go_round(craft.estimator.inertial.position_ned_m, craft.tuning.wings.circle_m)
            case _:
                super()._start(item)

    def _head_for(self, target: Vector3, item: StoredItem) -> None:
        self._path.head_for(target, self._line_start)
        self.trajectory.go_to(target)
        self._centre, self._line_start = None, target
        if item.command in _CIRCLES:
            radius = item.parameters[2] if item.command is not MissionCommand.LOITER_TO_HEIGHT else item.parameters[1]
            self._go_round(target, circle_of(radius, self.craft.tuning.wings.circle_m))

    def _is_reached(self, item: StoredItem) -> bool:
        target = self.trajectory.target
        off_height = abs(self.craft.estimator.inertial.position_ned_m[2] - target[2])
        if self._centre is not None:
            is_high = item.command is not MissionCommand.LOITER_TO_HEIGHT or off_height < _HEIGHT_M
            return is_high and self._path.is_round(self._centre, self._radius_m)
        radius = item.parameters[1] if item.command is MissionCommand.WAYPOINT else 0.0
        if not self._path.is_there(radius if radius > 0.0 else self.craft.tuning.acceptance_radius_m):
            return False
        if holds(item) and item.parameters[0] > 0.0:
            self._go_round(target, self.craft.tuning.wings.circle_m)
        return True

    def _go_in_circles(self, item: StoredItem) -> None:
        """Stays on the circle for as long as its turns take."""
        around_s = 2.0 * pi * abs(self._radius_m) / max(1.0, self.craft.airspeed_m_s)
        self._wait_until_s = self.craft.now_s + max(0.0, item.parameters[0]) * around_s

    def _leave_sub(self) -> None:
        """A take-off, a landing or a return inside the mission has ended."""
        self._line_start = None
        super()._leave_sub()

    def _finish(self) -> None:
        super()._finish()
        if not self.craft.is_landed:
            self.craft.send_text(Severity.INFO, "Mission complete, returning to circle")
            n, e, ground = nearest_goal(self.craft)
            self._go_round(
                (n, e, ground - abs(self.craft.tuning.wings.return_height_m)), self.craft.tuning.wings.circle_m
            )

    def skip_to(self, index: int) -> None:
        """Makes another item the current one, from here."""
        super().skip_to(index)
        self._line_start = None

    def go_on(self) -> None:
        """Resumes after a pause, from here."""
        super().go_on()
        self._line_start = None
