"""Manual flight modes: stabilize, altitude and position."""

from math import copysign, cos, hypot, nan, radians, sin, tan

from gloc3.messages.frames import GRAVITY_M_S2, Vector3, from_euler, wrap_pi
from gloc3_sitl.autopilot.behaviours.base import PERIOD_S, Activity
from gloc3_sitl.autopilot.control.setpoint import LANDED, AttitudeSetpoint, MotionSetpoint, Setpoint
from gloc3_sitl.autopilot.craft import Craft

_LEAN_RAD = radians(30.0)
_YAW_RATE_RAD_S = radians(120.0)
_DEAD_BAND = 0.06


def stick(value: float) -> float:
    """A stick's deflection without its dead band."""
    size = abs(value)
    return 0.0 if size < _DEAD_BAND else copysign((size - _DEAD_BAND) / (1.0 - _DEAD_BAND), value)


class Stabilize(Activity):
    """Sticks are lean and turn rate, the throttle is thrust."""

    __slots__ = ("_yaw_rad",)

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self._yaw_rad = craft.estimator.yaw_rad

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        pilot, tuning = self.craft.pilot, self.craft.tuning
        throttle = pilot.throttle if pilot.is_on else 0.0
        if self.craft.is_landed and throttle < 0.1:
            self._yaw_rad = self.craft.estimator.yaw_rad
            return LANDED
        rate = stick(pilot.yaw) * _YAW_RATE_RAD_S
        self._yaw_rad = wrap_pi(self._yaw_rad + rate * PERIOD_S)
        attitude = from_euler(stick(pilot.roll) * _LEAN_RAD, stick(pilot.pitch) * _LEAN_RAD, self._yaw_rad)
        hover = tuning.hover_thrust
        thrust = 2.0 * throttle * hover if throttle < 0.5 else hover + (throttle - 0.5) * 2.0 * (1.0 - hover)
        return AttitudeSetpoint(ned_from_frd=attitude, rate_frd_rad_s=(0.0, 0.0, rate), thrust=thrust)


class Altitude(Activity):
    """Sticks are lean and turn rate, the throttle is climb rate, and its middle holds the height."""

    __slots__ = ("_down_m", "_yaw_rad")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self._yaw_rad = craft.estimator.yaw_rad
        self._down_m = craft.estimator.inertial.position_ned_m[2]

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped."""
        self._down_m += jump_ned_m[2]

    def resync(self) -> None:
        """Holds the height at which the vehicle is."""
        self._down_m = self.craft.estimator.inertial.position_ned_m[2]

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft = self.craft
        climb, rate = self._climb_m_s(), stick(craft.pilot.yaw) * _YAW_RATE_RAD_S
        if craft.is_landed and climb <= 0.0:
            self.resync()
            self._yaw_rad = craft.estimator.yaw_rad
            return LANDED
        self._yaw_rad = wrap_pi(self._yaw_rad + rate * PERIOD_S)
        forward, right = -stick(craft.pilot.pitch), stick(craft.pilot.roll)
        lean = min(_LEAN_RAD, craft.tuning.gains.tilt_rad)
        cosine, sine = cos(self._yaw_rad), sin(self._yaw_rad)
        push = GRAVITY_M_S2 * tan(lean)
        n, e = push * (forward * cosine - right * sine), push * (forward * sine + right * cosine)
        down = self._hold_height(climb)
        return MotionSetpoint(
            position_ned_m=(nan, nan, down),
            velocity_ned_m_s=(nan, nan, -climb),
            acceleration_ned_m_s2=(n, e, 0.0),
            yaw_rad=self._yaw_rad,
            yaw_rate_rad_s=rate,
        )

    def _climb_m_s(self) -> float:
        limits = self.craft.tuning.limits
        throttle = stick(2.0 * self.craft.pilot.throttle - 1.0)
        return throttle * (limits.speed_up_m_s if throttle > 0.0 else limits.speed_down_m_s)

    def _hold_height(self, climb_m_s: float) -> float:
        """Height to hold, as NED down; NaN while the pilot climbs or sinks."""
        if climb_m_s:
            self._down_m = self.craft.estimator.inertial.position_ned_m[2] - 0.3 * climb_m_s
            return nan
        return self._down_m


class Position(Altitude):
    """Sticks are velocity over ground; the middle stops and holds the place."""

    __slots__ = ("_place", "_velocity")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        inertial = craft.estimator.inertial
        self._place: Vector3 = inertial.position_ned_m
        self._velocity: Vector3 = inertial.velocity_ned_m_s

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped."""
        super().on_jump(jump_ned_m)
        n, e, d = self._place
        self._place = (n + jump_ned_m[0], e + jump_ned_m[1], d)

    def resync(self) -> None:
        """Holds the place where the vehicle is."""
        super().resync()
        self._place = self.craft.estimator.inertial.position_ned_m
        self._velocity = (0.0, 0.0, 0.0)

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        craft = self.craft
        climb, rate = self._climb_m_s(), stick(craft.pilot.yaw) * _YAW_RATE_RAD_S
        if craft.is_landed and climb <= 0.0:
            self.resync()
            self._yaw_rad = craft.estimator.yaw_rad
            return LANDED
        self._yaw_rad = wrap_pi(self._yaw_rad + rate * PERIOD_S)
        limits = craft.tuning.limits
        forward = -stick(craft.pilot.pitch) * limits.speed_xy_m_s
        right = stick(craft.pilot.roll) * limits.speed_xy_m_s
        cosine, sine = cos(self._yaw_rad), sin(self._yaw_rad)
        vn, ve, _ = self._velocity
        dn, de = forward * cosine - right * sine - vn, forward * sine + right * cosine - ve
        step, change = limits.acceleration_xy_m_s2 * PERIOD_S, hypot(dn, de)
        share = step / change if change > step else 1.0
        vn, ve = vn + dn * share, ve + de * share
        self._velocity = (vn, ve, 0.0)
        n, e, _ = self._place
        n, e = n + vn * PERIOD_S, e + ve * PERIOD_S
        at_n, at_e, _ = craft.estimator.inertial.position_ned_m
        away = hypot(n - at_n, e - at_e)
        if away > 2.0:
            n, e = at_n + (n - at_n) * 2.0 / away, at_e + (e - at_e) * 2.0 / away
        self._place = (n, e, 0.0)
        return MotionSetpoint(
            position_ned_m=(n, e, self._hold_height(climb)),
            velocity_ned_m_s=(vn, ve, -climb),
            yaw_rad=self._yaw_rad,
            yaw_rate_rad_s=rate,
        )
