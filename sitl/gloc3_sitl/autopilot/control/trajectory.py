"""A smooth trajectory to a position, from any start: position, velocity and acceleration within limits."""

from dataclasses import dataclass
from math import hypot, sqrt

from gloc3.messages.frames import Vector3


@dataclass(slots=True, kw_only=True)
class TrajectoryLimits:
    """Limits of speed, acceleration and jerk, in m/s, m/s^2 and m/s^3."""

    speed_xy_m_s: float = 5.0
    speed_up_m_s: float = 2.0
    speed_down_m_s: float = 1.0
    acceleration_xy_m_s2: float = 2.5
    acceleration_z_m_s2: float = 2.0
    jerk_m_s3: float = 8.0


_NEAR_GAIN = 1.1
"""Approach speed per metre close to the target, in 1/s."""
_RESPONSE_S = 0.15
"""Time constant with which the wanted speed is approached."""
_BRAKING_SHARE = 0.7
"""Part of the acceleration that braking is planned with."""


def approach_speed_m_s(distance_m: float, deceleration_m_s2: float) -> float:
    """Largest speed with enough distance to stop; linear close to the target."""
    near = deceleration_m_s2 / (_NEAR_GAIN * _NEAR_GAIN)
    if distance_m < near:
        return _NEAR_GAIN * distance_m
    return sqrt(2.0 * deceleration_m_s2 * (distance_m - 0.5 * near))


def wanted_speed_m_s(
    distance_m: float, speed_m_s: float, acceleration_m_s2: float, braking_m_s2: float, jerk_m_s3: float
) -> float:
    """Speed to aim for towards a target, with the time that it takes to begin to brake in mind.

    Looks ahead to the moment at which the braking would be reached if it began now, and aims lower now by as much as
    the speed then would be too high.
    """
    braking = min(braking_m_s2, _NEAR_GAIN * max(speed_m_s, 0.0))
    change = (acceleration_m_s2 + braking) / jerk_m_s3
    if change <= 0.0:
        return approach_speed_m_s(max(distance_m, 0.0), braking_m_s2)
    then_m_s = speed_m_s + change * (acceleration_m_s2 - 0.5 * jerk_m_s3 * change)
    change_m = change * (speed_m_s + change * (0.5 * acceleration_m_s2 - jerk_m_s3 * change / 6.0))
    allowed = approach_speed_m_s(max(distance_m - change_m, 0.0), braking_m_s2)
    return max(0.0, speed_m_s + allowed - then_m_s)


class SmoothTrajectory:
    """A point that moves to a target with limited speed, acceleration and jerk.

    Horizontally it follows the line to the target from the position at which the target was set. The height moves
    within its own limits, slowed for simultaneous arrival when `is_straight`.
    """

    __slots__ = ("_leg_start", "acceleration", "limits", "position", "target", "velocity")

    def __init__(self, limits: TrajectoryLimits, position: Vector3, velocity: Vector3 = (0.0, 0.0, 0.0)) -> None:
        self.limits = limits
        self.position = position
        self.velocity = velocity
        self.acceleration: Vector3 = (0.0, 0.0, 0.0)
        self.target = position
        self._leg_start: Vector3 | None = None

    def go_to(self, target: Vector3, leg_start: Vector3 | None = None) -> None:
        """Heads for a NED position; with `leg_start` along the line from there, not just straight from here."""
        self.target = target
        self._leg_start = leg_start

    def stop(self) -> None:
        """Makes the nearest place at which it can stop the target."""
        vn, ve, vd = self.velocity
        speed = hypot(vn, ve)
        limits = self.limits
        stop_m = _stopping_distance_m(speed, limits.acceleration_xy_m_s2)
        share = stop_m / speed if speed > 1e-6 else 0.0
        n, e, d = self.position
        down = _stopping_distance_m(abs(vd), limits.acceleration_z_m_s2)
        self.go_to((n + vn * share, e + ve * share, d + (down if vd > 0.0 else -down)))

    @property
    def distance_m(self) -> float:
        """From the moving point to the target."""
        n, e, d = self.position
        tn, te, td = self.target
        return sqrt((tn - n) ** 2 + (te - e) ** 2 + (td - d) ** 2)

    def advance(self, dt_s: float) -> None:
        """Advances by one period."""
        limits = self.limits
        n, e, d = self.position
        vn, ve, vd = self.velocity
        an, ae, ad = self.acceleration
        tn, te, td = self.target
        to_n, to_e, to_d = tn - n, te - e, td - d
        distance = hypot(to_n, to_e)
        height = abs(to_d)
        speed_z = limits.speed_up_m_s if to_d < 0.0 else limits.speed_down_m_s
        sign = 1.0 if to_d > 0.0 else -1.0
        braking = _BRAKING_SHARE * limits.acceleration_z_m_s2
        speed_z = min(speed_z, wanted_speed_m_s(height, sign * vd, sign * ad, braking, limits.jerk_m_s3))
        speed = limits.speed_xy_m_s
        if distance > 1e-6:
            along_v, along_a = (vn * to_n + ve * to_e) / distance, (an * to_n + ae * to_e) / distance
            braking = _BRAKING_SHARE * limits.acceleration_xy_m_s2
            speed = min(speed, wanted_speed_m_s(distance, along_v, along_a, braking, limits.jerk_m_s3))
        if self._leg_start is not None and height > 0.2 and distance > 0.2:
            # On a leg both arrive together, so that the way is straight in space too.
            if height * speed > distance * speed_z:
                speed = max(distance * speed_z / height, 0.1)
            else:
                speed_z = max(height * speed / distance, 0.1)
        if distance > 1e-6:
            wanted_n, wanted_e = to_n * speed / distance, to_e * speed / distance
            if self._leg_start is not None and distance > 0.5:
                wanted_n, wanted_e = self._along_leg(n, e, speed)
        else:
            wanted_n = wanted_e = 0.0
        wanted_d = sign * speed_z
        # Acceleration towards the wanted velocity, limited, then its change limited.
        most = limits.acceleration_xy_m_s2
        acc_n, acc_e = (wanted_n - vn) / _RESPONSE_S, (wanted_e - ve) / _RESPONSE_S
        size = hypot(acc_n, acc_e)
        if size > most:
            acc_n *= most / size
            acc_e *= most / size
        most = limits.acceleration_z_m_s2
        acc_d = max(-most, min(most, (wanted_d - vd) / _RESPONSE_S))
        change = limits.jerk_m_s3 * dt_s
        jerk_n, jerk_e = acc_n - an, acc_e - ae
        size = hypot(jerk_n, jerk_e)
        if size > change:
            jerk_n *= change / size
            jerk_e *= change / size
        an, ae = an + jerk_n, ae + jerk_e
        ad += max(-change, min(change, acc_d - ad))
        vn, ve, vd = vn + an * dt_s, ve + ae * dt_s, vd + ad * dt_s
        self.acceleration = (an, ae, ad)
        self.velocity = (vn, ve, vd)
        self.position = (n + vn * dt_s, e + ve * dt_s, d + vd * dt_s)

    def _along_leg(self, n: float, e: float, speed: float) -> tuple[float, float]:
        """Velocity along the leg, with what brings the point back onto its line."""
        assert self._leg_start is not None
        start_n, start_e, _ = self._leg_start
        tn, te, _ = self.target
        leg_n, leg_e = tn - start_n, te - start_e
        length = hypot(leg_n, leg_e)
        if length < 0.1:
            distance = hypot(tn - n, te - e)
            return (tn - n) * speed / distance, (te - e) * speed / distance
        un, ue = leg_n / length, leg_e / length
        aside = (n - start_n) * -ue + (e - start_e) * un
        back = max(-0.7 * speed, min(0.7 * speed, -_NEAR_GAIN * aside))
        along = sqrt(max(speed * speed - back * back, 0.0))
        if (tn - n) * un + (te - e) * ue < 0.0:
            along = -along
        return un * along - ue * back, ue * along + un * back


def _stopping_distance_m(speed_m_s: float, acceleration_m_s2: float) -> float:
    """Way to stop from a speed, with some for the change of acceleration."""
    return speed_m_s * (0.5 * speed_m_s / (_BRAKING_SHARE * acceleration_m_s2) + 0.35)
