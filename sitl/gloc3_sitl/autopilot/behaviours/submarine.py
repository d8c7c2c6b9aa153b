"""ArduSub's modes, where they differ from those of multirotors."""

from math import cos, nan, sin

from gloc3.messages.frames import Vector3, wrap_pi
from gloc3_sitl.autopilot.behaviours.base import PERIOD_S, Activity
from gloc3_sitl.autopilot.behaviours.piloted import stick
from gloc3_sitl.autopilot.control.setpoint import MotionSetpoint, Setpoint
from gloc3_sitl.autopilot.craft import Craft

_PUSH_M_S2 = 1.0
"""Acceleration at full stick, m/s²."""
_YAW_RATE_RAD_S = 0.6
_AT_SURFACE_M = 0.3
_FLOATS_WITHIN_M = 0.02
"""So close to its depth at the surface it counts as surfaced."""


class SubmarineSticks(Activity):
    """MANUAL and STABILIZE: the sticks push, and nothing holds a depth."""

    __slots__ = ("_yaw_rad",)

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self._yaw_rad = craft.estimator.yaw_rad

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        return MotionSetpoint(
            acceleration_ned_m_s2=(*self.push(), -self._heave() * _PUSH_M_S2),
            yaw_rad=self.turn(),
            yaw_rate_rad_s=self._rate(),
        )

    def push(self) -> tuple[float, float]:
        """Horizontal acceleration by the sticks, north and east."""
        pilot = self.craft.pilot
        if not pilot.is_on:
            return 0.0, 0.0
        forward, right = -stick(pilot.pitch) * _PUSH_M_S2, stick(pilot.roll) * _PUSH_M_S2
        cosine, sine = cos(self._yaw_rad), sin(self._yaw_rad)
        return forward * cosine - right * sine, forward * sine + right * cosine

    def turn(self) -> float:
        """The heading, advanced by the stick."""
        self._yaw_rad = wrap_pi(self._yaw_rad + self._rate() * PERIOD_S)
        return self._yaw_rad

    def _heave(self) -> float:
        pilot = self.craft.pilot
        return stick(2.0 * pilot.throttle - 1.0) if pilot.is_on else 0.0

    def _rate(self) -> float:
        pilot = self.craft.pilot
        return stick(pilot.yaw) * _YAW_RATE_RAD_S if pilot.is_on else 0.0


class DepthHold(SubmarineSticks):
    """ALT_HOLD: the sticks push and turn, and the depth is held where the throttle is left in its middle."""

    __slots__ = ("_down_m",)

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        down_m, surface_m = craft.estimator.inertial.position_ned_m[2], _surface_m(craft)
        self._down_m = max(0.0, down_m if down_m - surface_m > _AT_SURFACE_M else surface_m)

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped."""
        self._down_m += jump_ned_m[2]

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        heave, limits = self._heave(), self.craft.tuning.limits
        climb_m_s = heave * (limits.speed_up_m_s if heave > 0.0 else limits.speed_down_m_s)
        if climb_m_s:
            self._down_m = max(0.0, self.craft.estimator.inertial.position_ned_m[2])
        return MotionSetpoint(
            position_ned_m=(nan, nan, nan if climb_m_s else self._down_m),
            velocity_ned_m_s=(nan, nan, -climb_m_s),
            acceleration_ned_m_s2=(*self.push(), 0.0),
            yaw_rad=self.turn(),
            yaw_rate_rad_s=self._rate(),
        )


class SurfaceMode(SubmarineSticks):
    """SURFACE: up to the surface, where ALT_HOLD follows; the sticks push and turn, and no place is held."""

    __slots__ = ("is_done",)

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self.is_done = False

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft = self.craft
        down_m = craft.estimator.inertial.position_ned_m[2] - _surface_m(craft)
        self.is_done = down_m <= craft.tuning.floats_at_m + _FLOATS_WITHIN_M
        climb_m_s = craft.tuning.limits.speed_up_m_s if down_m > _AT_SURFACE_M else 0.5 * max(0.0, down_m)
        return MotionSetpoint(
            velocity_ned_m_s=(nan, nan, -climb_m_s),
            acceleration_ned_m_s2=(*self.push(), 0.0),
            yaw_rad=self.turn(),
            yaw_rate_rad_s=self._rate(),
        )


def _surface_m(craft: Craft) -> float:
    """Where it floats, as NED down: its home, where it was armed."""
    return 0.0 if craft.home is None else craft.home.position_ned_m[2]


__all__ = ["DepthHold", "SubmarineSticks", "SurfaceMode"]
