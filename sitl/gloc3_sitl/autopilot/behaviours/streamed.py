"""Streamed control: external setpoints, tracked directly (PX4) or shaped and with a timeout (ArduPilot)."""

from math import nan

from gloc3.messages.frames import Vector3
from gloc3_sitl.autopilot.behaviours.base import GoesTo, Mover, TakesOff
from gloc3_sitl.autopilot.behaviours.climb import ClimbToHeight
from gloc3_sitl.autopilot.control.setpoint import LANDED, AttitudeSetpoint, MotionSetpoint, Setpoint
from gloc3_sitl.autopilot.craft import Craft


class Offboard(Mover):
    """Flies the newest setpoint as it is; the failsafe handles the loss of setpoints."""

    __slots__ = ("_yaw_hold_rad",)

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self._yaw_hold_rad = self.yaw_rad

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft = self.craft
        setpoint = craft.stream.setpoint
        if setpoint is None:
            return LANDED if craft.is_landed else self.fly()
        if isinstance(setpoint, AttitudeSetpoint):
            return LANDED if craft.is_landed and setpoint.thrust < 0.1 else setpoint
        if craft.is_landed and not requests_climb(setpoint, craft.estimator.inertial.position_ned_m[2]):
            return LANDED
        return setpoint


class StreamedAttitude(Mover):
    """ArduPilot's Guided_NoGPS: attitudes alone, and level at the same height when they are not renewed."""

    __slots__ = ()

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft = self.craft
        setpoint = craft.stream.setpoint
        is_fresh = craft.stream.is_fresh(craft.now_s, craft.tuning.stream_timeout_s)
        if isinstance(setpoint, AttitudeSetpoint) and is_fresh:
            return LANDED if craft.is_landed and setpoint.thrust < 0.1 else setpoint
        if craft.is_landed:
            return LANDED
        return MotionSetpoint(velocity_ned_m_s=(nan, nan, 0.0), yaw_rad=self.yaw_rad)


class Guided(Mover, GoesTo, TakesOff):
    """ArduPilot's Guided: take-off, go to, velocities that stop when they are not renewed, attitudes."""

    __slots__ = ("_climb", "_seen_s", "_stopped")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self.trajectory.stop()
        self._climb: ClimbToHeight | None = None
        self._seen_s = craft.stream.received_s
        self._stopped = True

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped."""
        super().on_jump(jump_ned_m)
        if self._climb is not None:
            self._climb.on_jump(jump_ned_m)

    def take_off(self, target_down_m: float) -> None:
        """Climbs from the ground to a height, as NED down."""
        self._climb = ClimbToHeight(self.craft, target_down_m)

    def go_to(self, position_ned_m: Vector3, yaw_rad: float = nan, speed_m_s: float = nan) -> None:
        """Flies to a place and holds there, with the usual speed."""
        del speed_m_s
        if not self._stopped:
            self.resync()
        self._stopped = True
        self._climb = None
        self.trajectory.go_to(position_ned_m, self.trajectory.position)
        if yaw_rad == yaw_rad:
            self.yaw_wanted_rad = yaw_rad

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft = self.craft
        if self._climb is not None:
            setpoint = self._climb.update()
            if not self._climb.is_done:
                return setpoint
            self.trajectory, self._climb = self._climb.trajectory, None
            self.trajectory.limits = craft.tuning.limits
            self._seen_s = craft.stream.received_s
        if craft.is_landed:
            self.resync()
            self._seen_s = craft.stream.received_s
            return LANDED
        stream = craft.stream
        if stream.received_s > self._seen_s:
            self._seen_s = stream.received_s
            wanted = stream.setpoint
            if isinstance(wanted, MotionSetpoint) and is_place_only(wanted):
                self.go_to(wanted.position_ned_m, wanted.yaw_rad)
            else:
                self._stopped = False
        if self._stopped:
            return self.fly()
        if not stream.is_fresh(craft.now_s, craft.tuning.stream_timeout_s):
            self._stopped = True
            self.resync()
            self.yaw_rad = self.yaw_wanted_rad = craft.estimator.yaw_rad
            self.trajectory.stop()
            return self.fly()
        assert stream.setpoint is not None
        return stream.setpoint


def is_place_only(setpoint: MotionSetpoint) -> bool:
    """Whether it is a place to go to, not a motion to follow."""
    return setpoint.position_ned_m[0] == setpoint.position_ned_m[0] and not any(
        value == value and value != 0.0 for value in setpoint.velocity_ned_m_s
    )


def requests_climb(setpoint: MotionSetpoint, down_m: float) -> bool:
    """Whether a setpoint leads off the ground."""
    wanted, speed = setpoint.position_ned_m[2], setpoint.velocity_ned_m_s[2]
    return wanted < down_m - 0.1 if wanted == wanted else speed < -0.05 if speed == speed else False
