"""The modes of a rover or boat, as in ArduPilot's Rover."""

from math import atan2, hypot, nan
from typing import Final

from gloc3.messages.envelope import Severity
from gloc3.messages.frames import Vector3, yaw_of
from gloc3_sitl.autopilot.behaviours.base import Activity, GoesTo
from gloc3_sitl.autopilot.behaviours.helm import REST, SteeringTarget, stopping_place
from gloc3_sitl.autopilot.behaviours.mission import MissionFlight, holds
from gloc3_sitl.autopilot.behaviours.return_home import nearest_goal
from gloc3_sitl.autopilot.control.setpoint import LANDED, AttitudeSetpoint, DriveSetpoint, MotionSetpoint, Setpoint
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.plans import MissionCommand, StoredItem

_DEAD_BAND: Final = 0.06
STREAM_S: Final = 3.0
"""Validity of headings and speeds without renewal, s."""
_STANDING_M_S: Final = 0.05
_NOT_FOR_DRIVING: Final = frozenset({MissionCommand.TAKE_OFF, MissionCommand.LAND})


def _stick(value: float) -> float:
    return 0.0 if abs(value) < _DEAD_BAND else value


class ManualDrive(Activity):
    """Manual: the sticks are throttle and steering."""

    __slots__ = ()

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        pilot = self.craft.pilot
        if not self.craft.is_armed:
            return LANDED
        throttle = _stick(2.0 * pilot.throttle - 1.0) if pilot.is_on else 0.0
        return DriveSetpoint(is_direct=True, throttle=throttle, steering=_stick(pilot.roll) if pilot.is_on else 0.0)


class SteeredBySticks(Activity):
    """Acro and Steering: the sticks are speed and turn rate."""

    __slots__ = ()

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        pilot, tuning = self.craft.pilot, self.craft.tuning
        if not self.craft.is_armed:
            return LANDED
        if not pilot.is_on:
            return REST
        speed = _stick(2.0 * pilot.throttle - 1.0) * tuning.drive.cruise_speed_m_s
        return DriveSetpoint(speed_m_s=speed, turn_rate_rad_s=_stick(pilot.roll) * tuning.drive.rate_max_rad_s)


class Stop(Activity):
    """Hold: the drives stop, wherever the vehicle is."""

    __slots__ = ()

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        return REST if self.craft.is_armed else LANDED


class DriveLoiter(GoesTo):
    """Stops, and stays there; a boat goes back when it has drifted."""

    __slots__ = ("_helm", "_place")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self._helm = SteeringTarget(craft)
        self._place = stopping_place(craft)

    def go_to(self, position_ned_m: Vector3, yaw_rad: float = nan, speed_m_s: float = nan) -> None:
        """Stays somewhere else."""
        del yaw_rad, speed_m_s
        self._place = position_ned_m

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped; the vehicle stays where it is."""
        n, e, d = self._place
        self._place = (n + jump_ned_m[0], e + jump_ned_m[1], d)

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        if not self.craft.is_armed:
            self._place = self.craft.estimator.inertial.position_ned_m
            return LANDED
        return self._helm.stay(self._place)


class GuidedDrive(GoesTo):
    """Guided: goes to a place and stays there, or steers the heading and the speed that are streamed.

    As Rover takes them: a position is a place to go to; a velocity alone is a heading and a speed; with a yaw beside it,
    that is the heading; with a turn rate, it turns by that. After 3 s without a new one it stops.
    """

    __slots__ = ("_helm", "_is_going", "_is_guided", "_place", "_seen_s")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self._helm = SteeringTarget(craft)
        self._place = stopping_place(craft)
        self._is_going = self._is_guided = False
        self._seen_s = craft.stream.received_s

    def go_to(self, position_ned_m: Vector3, yaw_rad: float = nan, speed_m_s: float = nan) -> None:
        """Drives to a position and stays there; a speed applies to this leg."""
        del yaw_rad
        limits = self.craft.tuning.limits
        self._helm.speed_m_s = speed_m_s if speed_m_s > 0.0 else limits.speed_xy_m_s
        self._helm.head_for(position_ned_m)
        self._place, self._is_going, self._is_guided = position_ned_m, True, False

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft, stream = self.craft, self.craft.stream
        if not craft.is_armed:
            self._place, self._is_going, self._is_guided = craft.estimator.inertial.position_ned_m, False, False
            self._seen_s = stream.received_s
            return LANDED
        if stream.received_s > self._seen_s:
            self._seen_s = stream.received_s
            wanted = stream.setpoint
            is_place = isinstance(wanted, MotionSetpoint) and wanted.position_ned_m[0] == wanted.position_ned_m[0]
            if is_place and isinstance(wanted, MotionSetpoint):
                if not self._is_going or wanted.position_ned_m[:2] != self._place[:2]:
                    self.go_to(wanted.position_ned_m)
            else:
                self._is_guided, self._is_going = True, False
        if self._is_guided:
            if stream.is_fresh(craft.now_s, STREAM_S) and stream.setpoint is not None:
                return self._guided(stream.setpoint)
            self._is_guided = False
            self._place = stopping_place(craft)
            craft.send_text(Severity.WARNING, "target not received last 3secs, stopping")
        if self._is_going:
            if not self._helm.is_there(craft.tuning.acceptance_radius_m):
                return self._helm.steer()
            self._is_going = False
        return self._helm.stay(self._place)

    def _guided(self, wanted: Setpoint) -> Setpoint:
        if isinstance(wanted, AttitudeSetpoint):
            speed = wanted.thrust * self.craft.tuning.drive.cruise_speed_m_s
            heading = nan if wanted.ned_from_frd is None else yaw_of(wanted.ned_from_frd)
            return DriveSetpoint(speed_m_s=speed, heading_rad=heading, turn_rate_rad_s=wanted.rate_frd_rad_s[2])
        assert isinstance(wanted, MotionSetpoint)
        vn, ve, _ = wanted.velocity_ned_m_s
        speed = hypot(vn, ve) if vn == vn else 0.0
        if wanted.yaw_rad == wanted.yaw_rad:
            heading = wanted.yaw_rad
        else:
            heading = atan2(ve, vn) if speed > _STANDING_M_S and not wanted.yaw_rate_rad_s else nan
        speed = min(speed, self.craft.tuning.gains.speed_xy_m_s)
        is_at_rest = speed <= _STANDING_M_S and heading != heading and not wanted.yaw_rate_rad_s
        return DriveSetpoint(
            speed_m_s=speed, heading_rad=heading, turn_rate_rad_s=wanted.yaw_rate_rad_s, is_at_rest=is_at_rest
        )


class DriveHome(Activity):
    """RTL: straight back to home, or to the nearest rally point, and stays there."""

    __slots__ = ("_goal", "_helm", "is_done")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self.is_done = False
        self._helm = SteeringTarget(craft)
        self._helm.speed_m_s = craft.tuning.drive.return_speed_m_s or craft.tuning.limits.speed_xy_m_s
        self._goal = nearest_goal(craft)
        self._helm.head_for(self._goal)

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        if not self.craft.is_armed:
            return LANDED
        if not self.is_done and not self._helm.is_there(self.craft.tuning.acceptance_radius_m):
            return self._helm.steer()
        self.is_done = True
        return self._helm.stay(self._goal)


class Retrace(Activity):
    """SmartRTL: back to home along the recorded path, without its loops."""

    __slots__ = ("_helm", "_places", "is_done")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self.is_done = False
        self._helm = SteeringTarget(craft)
        self._helm.speed_m_s = craft.tuning.drive.return_speed_m_s or craft.tuning.limits.speed_xy_m_s
        home = nearest_goal(craft)
        self._places = [home, *craft.track_points]
        craft.records_track = False
        self._next()

    def _next(self) -> None:
        target = self._places.pop()
        self._helm.head_for(target, beyond=self._places[-1] if self._places else None)

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft = self.craft
        if not craft.is_armed:
            return LANDED
        if not self.is_done and self._helm.is_there(craft.tuning.acceptance_radius_m):
            self.is_done = not self._places
            if self._places:
                craft.track_points = craft.track_points[: len(self._places)]
                self._next()
        craft.records_track = self.is_done
        return self._helm.stay(self._helm.target) if self.is_done else self._helm.steer()


class MissionDrive(MissionFlight):
    """Auto: the items of the uploaded mission, along straight legs."""

    __slots__ = ("_helm", "_is_staying", "_legs_end")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self._helm = SteeringTarget(craft)
        self._is_staying = True
        self._legs_end: Vector3 | None = None

    def pause(self) -> None:
        """Stops here, inside the mode."""
        super().pause()
        self._stay(stopping_place(self.craft))

    def fly(self) -> Setpoint:
        """Steers on, or stays at the target."""
        self._helm.speed_m_s = self.trajectory.limits.speed_xy_m_s
        return self._helm.stay(self.trajectory.target) if self._is_staying else self._helm.steer()

    def _stay(self, place: Vector3) -> None:
        self.trajectory.go_to(place)
        self._is_staying = True

    def _is_instant(self, item: StoredItem) -> bool:
        if item.command not in _NOT_FOR_DRIVING:
            return super()._is_instant(item)
        self.craft.send_text(Severity.WARNING, f"Skipping invalid cmd #{int(item.command)}")
        self.craft.mission.current += 1
        return True

    def _start(self, item: StoredItem) -> None:
        match item.command:
            case MissionCommand.RETURN:
                self._sub = DriveHome(self.craft)
            case MissionCommand.DELAY | MissionCommand.CONDITION_DELAY:
                super()._start(item)
                self._stay(stopping_place(self.craft))
            case _:
                super()._start(item)

    def _head_for(self, target: Vector3, item: StoredItem) -> None:
        following = self.craft.mission.current + 1
        items = self.craft.plans.mission
        beyond = None
        if not (holds(item) and item.parameters[0] > 0.0) and following < len(items):
            after = items[following]
            if after.command in (MissionCommand.WAYPOINT, MissionCommand.SPLINE_WAYPOINT, MissionCommand.LOITER_TIME):
                beyond = self._place(after)
        self.trajectory.go_to(target)
        self._helm.head_for(target, self._legs_end, beyond)
        self._legs_end, self._is_staying = target, False

    def _is_reached(self, item: StoredItem) -> bool:
        if self._is_staying:
            return True
        radius = (
            item.parameters[1] if item.command in (MissionCommand.WAYPOINT, MissionCommand.SPLINE_WAYPOINT) else 0.0
        )
        if not self._helm.is_there(radius if radius > 0.0 else self.craft.tuning.acceptance_radius_m):
            return False
        if holds(item) and item.parameters[0] > 0.0:
            self._stay(self.trajectory.target)
        return True

    def _go_in_circles(self, item: StoredItem) -> None:
        """Goes on at once: this rover has no circles."""
        del item
        self._wait_until_s = self.craft.now_s

    def _finish(self) -> None:
        super()._finish()
        is_there = self._helm.is_there(self.craft.tuning.acceptance_radius_m)
        self._stay(self._helm.target if is_there else stopping_place(self.craft))

    def skip_to(self, index: int) -> None:
        """Makes another item the current one, from here."""
        super().skip_to(index)
        self._legs_end = None

    def go_on(self) -> None:
        """Resumes after a pause, from here."""
        super().go_on()
        self._legs_end = None
