"""Steers a driven vehicle to targets: along a straight leg, round its corner, and to a stop."""

from math import atan2, cos, hypot, pi
from typing import Final

from gloc3.line_of_sight import LineOfSight, corner_speed_m_s, slowed_m_s
from gloc3.messages.frames import Vector3, wrap_pi
from gloc3_sitl.autopilot.control.setpoint import DriveSetpoint
from gloc3_sitl.autopilot.craft import Craft
from gloc3_sitl.autopilot.periods import OUTER_S

_PIVOTED_RAD: Final = 0.15
_LEAST_M_S: Final = 0.25
"""Lowest speed along a leg until its end, m/s."""
_BRAKING_SHARE: Final = 0.5
_LEAST_LOOKAHEAD_M: Final = 1.0
_STRAIGHT_ON_RAD: Final = 0.5
_PAST_M: Final = 0.1

REST: Final = DriveSetpoint(is_at_rest=True)
"""Stops and stands."""


class SteeringTarget:
    """Target of the steering."""

    __slots__ = ("_craft", "_end_m_s", "_guide", "_is_pivoting", "left_m", "speed_m_s", "target")

    def __init__(self, craft: Craft) -> None:
        self._craft = craft
        self._guide = LineOfSight(craft.tuning.drive.integral)
        self.target: Vector3 = craft.estimator.inertial.position_ned_m
        self.left_m = 0.0
        """Way to the target, along the leg."""
        self.speed_m_s = craft.tuning.limits.speed_xy_m_s
        self._end_m_s = 0.0
        self._is_pivoting = False

    def head_for(self, target: Vector3, start: Vector3 | None = None, beyond: Vector3 | None = None) -> None:
        """Sets the next position.

        Args:
            target: NED.
            start: start of the straight leg to it; None for here.
            beyond: the position after it; None for a stop.
        """
        here = self._craft.estimator.inertial.position_ned_m
        begin = here if start is None or hypot(target[0] - start[0], target[1] - start[1]) < 0.5 else start
        before = self._guide.course_rad
        course = atan2(target[1] - begin[1], target[0] - begin[0])
        self._guide.follow(begin, target, keeps_drift=abs(wrap_pi(course - before)) < _STRAIGHT_ON_RAD)
        self.target = target
        self.left_m = hypot(target[0] - here[0], target[1] - here[1])
        gains = self._craft.tuning.drive
        self._end_m_s = 0.0
        if beyond is not None:
            turn = abs(wrap_pi(atan2(beyond[1] - target[1], beyond[0] - target[0]) - course))
            if not 0.0 < gains.pivot_angle_rad < turn:
                within = self._craft.tuning.acceptance_radius_m
                self._end_m_s = max(_LEAST_M_S, corner_speed_m_s(turn, within, 0.5 * gains.rate_max_rad_s))
        off = abs(wrap_pi(atan2(target[1] - here[1], target[0] - here[0]) - self._craft.estimator.yaw_rad))
        self._is_pivoting = 0.0 < gains.pivot_angle_rad < off

    def steer(self) -> DriveSetpoint:
        """The setpoint for the next 20 ms along the leg."""
        craft, gains = self._craft, self._craft.tuning.drive
        here = craft.estimator.inertial.position_ned_m
        speed = self.speed_m_s
        lookahead = max(_LEAST_LOOKAHEAD_M, speed / max(gains.position_p, 0.05))
        guidance = self._guide.update(here, lookahead, 0.0 if self._is_pivoting else OUTER_S)
        self.left_m = guidance.left_m
        off = wrap_pi(guidance.heading_rad - craft.estimator.yaw_rad)
        if self._is_pivoting:
            if abs(off) < _PIVOTED_RAD:
                self._is_pivoting = False
            rate = max(-gains.pivot_rate_rad_s, min(gains.pivot_rate_rad_s, gains.heading_p * off))
            return DriveSetpoint(turn_rate_rad_s=rate)
        speed = slowed_m_s(speed, guidance.left_m, self._end_m_s, _BRAKING_SHARE * gains.acceleration_m_s2)
        # A turn is begun slowly: the farther the nose is off, the less it helps to go on.
        speed *= max(0.2, cos(off))
        return DriveSetpoint(speed_m_s=max(speed, _LEAST_M_S), heading_rad=guidance.heading_rad)

    def is_there(self, within_m: float) -> bool:
        """Whether the target is that near, or has been passed no farther aside than twice that."""
        n, e, _ = self._craft.estimator.inertial.position_ned_m
        away = hypot(self.target[0] - n, self.target[1] - e)
        return away < within_m or (self.left_m < -_PAST_M and away < 2.0 * within_m)

    def stay(self, place: Vector3) -> DriveSetpoint:
        """Stays at a position: a boat drifts within its circle and returns, a rover stands."""
        craft, gains = self._craft, self._craft.tuning.drive
        if not gains.loiters:
            return REST
        n, e, _ = craft.estimator.inertial.position_ned_m
        north, east = place[0] - n, place[1] - e
        beyond = hypot(north, east) - gains.loiter_radius_m
        if beyond <= 0.0:
            return DriveSetpoint()
        speed = min(self.speed_m_s, gains.loiter_gain * beyond)
        bearing = atan2(east, north)
        if abs(wrap_pi(bearing - craft.estimator.yaw_rad)) > 1.6:  # nearer stern first
            return DriveSetpoint(speed_m_s=-speed, heading_rad=wrap_pi(bearing + pi))
        return DriveSetpoint(speed_m_s=speed, heading_rad=bearing)


def stopping_place(craft: Craft) -> Vector3:
    """Where the vehicle comes to rest if it brakes now."""
    inertial = craft.estimator.inertial
    (n, e, d), (vn, ve, _) = inertial.position_ned_m, inertial.velocity_ned_m_s
    share = 0.5 * hypot(vn, ve) / max(craft.tuning.drive.acceleration_m_s2, 0.1)
    return (n + vn * share, e + ve * share, d)
