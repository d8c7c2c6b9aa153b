"""Orbit: fly to a circle and follow it until the mode changes."""

from dataclasses import dataclass
from enum import IntEnum
from math import atan2, cos, hypot, isfinite, nan, sin, sqrt

from gloc3.messages.frames import Vector3
from gloc3_sitl.autopilot.behaviours.base import PERIOD_S, Mover
from gloc3_sitl.autopilot.control.setpoint import LANDED, MotionSetpoint, Setpoint
from gloc3_sitl.autopilot.craft import Craft

_LEAST_RADIUS_M = 1.0
_USUAL_RADIUS_M = 20.0
_USUAL_SPEED_M_S = 1.0
_MOST_SPEED_M_S = 10.0
_MOST_PULL_M_S2 = 2.0
_RAMP_M_S2 = 0.7
_LAG_M = 1.0


class Facing(IntEnum):
    """Directions of the nose, numbered as ORBIT_YAW_BEHAVIOUR."""

    CENTRE = 0
    AS_BEFORE = 1
    FREE = 2
    ALONG = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbitCircle:
    """The circle of an orbit."""

    centre_ned_m: Vector3
    """Its third part is the height to fly at, as NED down."""
    radius_m: float
    speed_m_s: float
    """Clockwise as seen from above when positive."""
    facing: Facing = Facing.CENTRE


def circle(centre_ned_m: Vector3, radius_m: float, speed_m_s: float, facing: Facing, largest_m: float) -> OrbitCircle:
    """A flyable circle: radius and speed are limited; NaN means the default.

    A negative radius reverses the direction, as in MAV_CMD_DO_ORBIT.
    """
    radius = abs(radius_m) if isfinite(radius_m) else _USUAL_RADIUS_M
    radius = max(_LEAST_RADIUS_M, min(largest_m, radius))
    speed = speed_m_s if isfinite(speed_m_s) else _USUAL_SPEED_M_S
    most = min(_MOST_SPEED_M_S, sqrt(_MOST_PULL_M_S2 * radius))
    speed = max(-most, min(most, speed))
    return OrbitCircle(
        centre_ned_m=centre_ned_m,
        radius_m=radius,
        speed_m_s=-speed if radius_m < 0.0 else speed,
        facing=facing,
    )


class Orbit(Mover):
    """Approaches the nearest point of the circle, then goes round with growing speed."""

    __slots__ = ("_angle_rad", "_speed_m_s", "circle", "is_round")

    def __init__(self, craft: Craft) -> None:
        super().__init__(craft)
        self.is_round = False
        self._angle_rad = self._speed_m_s = 0.0
        here = craft.estimator.inertial.position_ned_m
        self.circle = circle(here, nan, nan, Facing.CENTRE, craft.tuning.orbit_radius_m)
        self.trajectory.stop()

    def go_round(self, wanted: OrbitCircle) -> None:
        """Makes this the circle; the vehicle flies to its nearest point first."""
        if self.is_round:
            self.resync()
        self.circle, self.is_round, self._speed_m_s = wanted, False, 0.0
        n, e, d = wanted.centre_ned_m
        here_n, here_e, _ = self.trajectory.position
        self._angle_rad = atan2(here_e - e, here_n - n)
        radius = wanted.radius_m
        self.trajectory.go_to((n + radius * cos(self._angle_rad), e + radius * sin(self._angle_rad), d))

    def on_jump(self, jump_ned_m: Vector3) -> None:
        """The position estimate has jumped: the circle stays fixed on Earth."""
        del jump_ned_m
        self.resync()

    def update(self) -> Setpoint:
        """The setpoint for the next 20 ms."""
        if self.craft.is_landed:
            self.resync()
            return LANDED
        self._face()
        if not self.is_round:
            self.is_round = self.trajectory.distance_m < 0.3
            return self.fly()
        return self._advance()

    def _advance(self) -> MotionSetpoint:
        wanted = self.circle
        step = _RAMP_M_S2 * PERIOD_S
        self._speed_m_s += max(-step, min(step, wanted.speed_m_s - self._speed_m_s))
        n, e, d = wanted.centre_ned_m
        radius, speed = wanted.radius_m, self._speed_m_s
        at_n, at_e, _ = self.craft.estimator.inertial.position_ned_m
        cosine, sine = cos(self._angle_rad), sin(self._angle_rad)
        lag = hypot(n + radius * cosine - at_n, e + radius * sine - at_e)
        share = max(0.0, min(1.0, 2.0 - lag / _LAG_M))
        self._angle_rad += share * speed / radius * PERIOD_S
        cosine, sine = cos(self._angle_rad), sin(self._angle_rad)
        pull = speed * speed / radius
        self.trajectory.position = (n + radius * cosine, e + radius * sine, d)
        self.trajectory.velocity = (-speed * sine, speed * cosine, 0.0)
        self.trajectory.acceleration = (-pull * cosine, -pull * sine, 0.0)
        return MotionSetpoint(
            position_ned_m=self.trajectory.position,
            velocity_ned_m_s=self.trajectory.velocity,
            acceleration_ned_m_s2=self.trajectory.acceleration,
            yaw_rad=self.turn(),
        )

    def _face(self) -> None:
        n, e, _ = self.circle.centre_ned_m
        at_n, at_e, _ = self.craft.estimator.inertial.position_ned_m
        match self.circle.facing:
            case Facing.CENTRE:
                self.yaw_wanted_rad = atan2(e - at_e, n - at_n)
            case Facing.ALONG if self.is_round:
                vn, ve, _ = self.trajectory.velocity
                self.yaw_wanted_rad = atan2(ve, vn)
            case _:
                pass
