"""Flies an uploaded mission, item by item."""

from dataclasses import replace
from math import atan2, hypot, isfinite, pi, radians

from gloc3.messages.envelope import Severity
from gloc3.messages.frames import Vector3, wrap_pi
from gloc3_sitl.autopilot.behaviours.base import Activity, FliesMission, Mover
from gloc3_sitl.autopilot.behaviours.climb import ClimbToHeight
from gloc3_sitl.autopilot.behaviours.land import LandInPlace
from gloc3_sitl.autopilot.behaviours.orbit import Facing, Orbit, circle
from gloc3_sitl.autopilot.behaviours.return_home import ReturnFlight
from gloc3_sitl.autopilot.control.setpoint import LANDED, Setpoint
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.mission import MissionState
from gloc3_sitl.autopilot.plans import INSTANT, MissionCommand, StoredItem

_MOST_INSTANT = 64
"""Items that are done at once in one period; a mission of nothing but jumps must not hang the vehicle."""
_HEIGHT_RADIUS_M = 0.8
CIRCLE_M, CIRCLING_M_S = 10.0, 2.0
"""ArduPilot's usual circle, and a speed that suits it."""


class MissionFlight(Mover, FliesMission):
    """Flies the current mission item; done after the last one."""

    __slots__ = ("_item", "_leg_start", "_sub", "_wait_until_s", "is_done")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft, replace(craft.tuning.limits))
        self.is_done = False
        self._item: StoredItem | None = None
        self._sub: Activity | None = None
        self._wait_until_s: float | None = None
        self._leg_start: Vector3 | None = None
        self.trajectory.stop()
        progress = craft.mission
        if progress.state is MissionState.COMPLETE and craft.is_armed:
            progress.restart(craft.first_item)
        progress.is_paused = False

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped: the vehicle corrects its path; positions stay fixed on Earth."""
        del jump_ned_m
        self.resync()

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft = self.craft
        progress = craft.mission
        if not craft.is_armed:
            self.resync()
            return LANDED
        if progress.is_paused:
            progress.state = MissionState.PAUSED
            return LANDED if craft.is_landed else self.fly()
        if self.is_done or not craft.plans.mission:
            return self._remainder()
        progress.state = MissionState.ACTIVE
        progress.outdated = None
        if self._item is None:
            self._begin()
        if self._item is None:
            return self._remainder()
        return self._carry_on(self._item)

    def skip_to(self, index: int) -> None:
        """Makes another item the current one."""
        self.craft.mission.current = index
        self._item = self._sub = self._wait_until_s = None
        self.is_done = False

    def pause(self) -> None:
        """Stops here, inside the mode."""
        self.craft.mission.is_paused = True
        self.trajectory.stop()

    def go_on(self) -> None:
        """Resumes after a pause."""
        self.craft.mission.is_paused = False
        self._item = self._sub = None

    # -- items ----------------------------------------------------------------------------------------------------

    def _remainder(self) -> Setpoint:
        if self.craft.is_landed:
            self.resync()
            return LANDED
        return self.fly()

    def _begin(self) -> None:
        """Starts the current item; items that are done at once are passed through."""
        craft = self.craft
        progress, items = craft.mission, craft.plans.mission
        for _ in range(_MOST_INSTANT):
            if progress.current >= len(items):
                self._finish()
                return
            item = items[progress.current]
            if self._is_instant(item):
                continue
            self._item = item
            self._wait_until_s = None
            self._start(item)
            return

    def _is_instant(self, item: StoredItem) -> bool:
        """Does an item that takes no time; true where it was one."""
        progress = self.craft.mission
        index = progress.current
        match item.command:
            case MissionCommand.JUMP | MissionCommand.DO_JUMP_TAG:
                target, repeats = self._jump_target(item), int(item.parameters[1])
                done = progress.jumps.get(index, 0)
                if repeats < 0 or done < repeats:
                    progress.jumps[index] = done + 1
                    progress.current = target
                else:
                    progress.jumps.pop(index, None)
                    progress.current += 1
                return True
            case MissionCommand.CHANGE_SPEED:
                speed = item.parameters[1]
                if speed > 0.0:
                    self.trajectory.limits.speed_xy_m_s = min(speed, self.craft.tuning.gains.speed_xy_m_s)
            case MissionCommand.CONDITION_YAW:
                turn = radians(item.parameters[0])
                if item.parameters[3]:
                    sign = -1.0 if item.parameters[2] < 0.0 else 1.0
                    turn = self.yaw_wanted_rad + sign * turn
                self.yaw_wanted_rad = wrap_pi(turn)
            case _ if item.command in INSTANT:
                pass
            case _:
                return False
        progress.reached.append(index)
        progress.current += 1
        return True

    def _jump_target(self, item: StoredItem) -> int:
        """Index of the item that a jump leads to; behind itself where its tag does not exist."""
        number = int(item.parameters[0])
        if item.command == MissionCommand.JUMP:
            return number
        items = enumerate(self.craft.plans.mission)
        tags = (at for at, one in items if one.command == MissionCommand.JUMP_TAG and one.parameters[0] == number)
        return next(tags, self.craft.mission.current + 1)

    def _start(self, item: StoredItem) -> None:
        """Sets out for an item."""
        craft = self.craft
        here = self.trajectory.position
        match item.command:
            case MissionCommand.DELAY | MissionCommand.CONDITION_DELAY:
                self._wait_until_s = craft.now_s + max(0.0, item.parameters[0])
                self.trajectory.stop()
            case MissionCommand.RETURN:
                self._sub = ReturnFlight(craft)
            case MissionCommand.TAKE_OFF | MissionCommand.VTOL_TAKE_OFF if craft.is_landed:
                self._sub = ClimbToHeight(craft, self._place(item)[2])
            case MissionCommand.LAND | MissionCommand.VTOL_LAND:
                n, e, _ = self._place(item)
                self._head_for((n, e, here[2]), item)
            case MissionCommand.TAKE_OFF | MissionCommand.VTOL_TAKE_OFF:
                self._head_for((here[0], here[1], min(here[2], self._place(item)[2])), item)
            case _:
                self._head_for(self._place(item), item)

    def _head_for(self, target: Vector3, item: StoredItem) -> None:
        n, e, _ = self.trajectory.position
        start = self._leg_start if self._leg_start is not None else self.trajectory.position
        self.trajectory.go_to(target, start)
        self._leg_start = target
        yaw = item.parameters[3]
        if self.craft.tuning.mission_uses_item_yaw and isfinite(yaw):
            self.yaw_wanted_rad = wrap_pi(radians(yaw))
        elif self.craft.tuning.mission_faces_course and hypot(target[0] - n, target[1] - e) > 1.0:
            self.yaw_wanted_rad = atan2(target[1] - e, target[0] - n)

    def _place(self, item: StoredItem) -> Vector3:
        """Where an item is, in NED; "here" where it does not say."""
        craft = self.craft
        n, e, _ = self.trajectory.position
        origin, home = craft.estimator.origin, craft.home
        base = 0.0 if home is None else home.position_ned_m[2]
        if origin is not None and item.has_place:
            n, e, _ = origin.ned_from_geo(item.latitude_deg, item.longitude_deg, origin.origin.altitude_m)
        if item.is_relative or origin is None:
            return (n, e, base - item.height_m)
        return (n, e, origin.origin.altitude_m - item.height_m)

    def _carry_on(self, item: StoredItem) -> Setpoint:
        """Flies the current item and advances when it is done."""
        craft = self.craft
        if self._sub is not None:
            setpoint = self._sub.update()
            has_turned = self._wait_until_s is not None and craft.now_s >= self._wait_until_s
            if has_turned and isinstance(self._sub, Orbit):
                self.trajectory = self._sub.trajectory
                self.trajectory.stop()
            if self._sub.is_done or has_turned:
                self._leave_sub()
            return setpoint
        setpoint = self.fly()
        if self._wait_until_s is not None:
            if craft.now_s >= self._wait_until_s:
                self._next()
            return setpoint
        if not self._is_reached(item):
            return setpoint
        match item.command:
            case MissionCommand.LAND | MissionCommand.VTOL_LAND:
                self._sub = LandInPlace(craft, self.trajectory.target)
            case MissionCommand.LOITER_UNLIMITED:
                pass
            case MissionCommand.LOITER_TURNS:
                self._go_in_circles(item)
            case _:
                self._wait_until_s = craft.now_s + (max(0.0, item.parameters[0]) if holds(item) else 0.0)
        return setpoint

    def _go_in_circles(self, item: StoredItem) -> None:
        """Goes round the place as often as the item says, on its radius or ArduPilot's usual one."""
        orbit, speed_m_s = Orbit(self.craft), min(CIRCLING_M_S, self.trajectory.limits.speed_xy_m_s)
        largest_m = self.craft.tuning.orbit_radius_m
        orbit.go_round(
            circle(self.trajectory.target, abs(item.parameters[2]) or CIRCLE_M, speed_m_s, Facing.ALONG, largest_m)
        )
        self._sub = orbit
        around_s = 2.0 * pi * orbit.circle.radius_m / max(0.1, abs(orbit.circle.speed_m_s))
        away_s = orbit.circle.radius_m / speed_m_s
        self._wait_until_s = self.craft.now_s + away_s + max(0.0, item.parameters[0]) * around_s

    def _leave_sub(self) -> None:
        """A take-off, landing or return inside the mission has ended."""
        if isinstance(self._sub, ClimbToHeight):
            limits = self.trajectory.limits
            self.trajectory = self._sub.trajectory
            self.trajectory.limits = limits
        self._leg_start = None
        self._sub = None
        self._next()

    def _is_reached(self, item: StoredItem) -> bool:
        radius = (
            item.parameters[1] if item.command in (MissionCommand.WAYPOINT, MissionCommand.SPLINE_WAYPOINT) else 0.0
        )
        if not radius > 0.0:
            radius = self.craft.tuning.acceptance_radius_m
        target = self.trajectory.target
        off_height = abs(self.craft.estimator.inertial.position_ned_m[2] - target[2])
        return self.horizontal_distance_to(target) < radius and off_height < _HEIGHT_RADIUS_M

    def _next(self) -> None:
        progress = self.craft.mission
        progress.reached.append(progress.current)
        progress.current += 1
        self._item = self._wait_until_s = None
        if progress.current >= len(self.craft.plans.mission):
            self._finish()

    def _finish(self) -> None:
        progress = self.craft.mission
        progress.state = MissionState.COMPLETE
        progress.current = max(0, len(self.craft.plans.mission) - 1)
        self.is_done = True
        if not self.craft.is_landed:
            self.trajectory.go_to(self.trajectory.target)
        self.craft.send_text(Severity.INFO, "Mission finished")


def holds(item: StoredItem) -> bool:
    """Whether the first parameter is a time to wait there."""
    return item.command in (MissionCommand.WAYPOINT, MissionCommand.SPLINE_WAYPOINT, MissionCommand.LOITER_TIME)
