"""Lateral guidance of planes by bank: L1 guidance (S. Park, J. Deyst, J. How 2004) and circles."""

from math import atan2, hypot, pi, sin, tau
from typing import Final

from gloc3.messages.frames import Vector3, wrap_pi

_LEAST_M_S: Final = 5.0


class LateralGuidance:
    """Lateral acceleration to the right, in m/s^2, from NED positions and velocities.

    Args:
        period_s: period of the convergence to a path; longer is gentler.
        damping: damping of the convergence.
    """

    def __init__(self, period_s: float, damping: float) -> None:
        self.period_s, self.damping = period_s, damping

    def along(self, here: Vector3, velocity: Vector3, begin: Vector3, end: Vector3) -> float:
        """Along the straight line, extended beyond its end."""
        speed = max(_LEAST_M_S, hypot(velocity[0], velocity[1]))
        ahead_m = self.damping * self.period_s * speed / pi
        north, east = end[0] - begin[0], end[1] - begin[1]
        length = hypot(north, east)
        if length < 1.0:
            return self.towards(here, velocity, end)
        north, east = north / length, east / length
        n, e = here[0] - begin[0], here[1] - begin[1]
        beside, course = n * east - e * north, atan2(east, north)
        reach = max(-0.7071, min(0.7071, beside / max(ahead_m, 0.1)))
        off = wrap_pi(course + _asin(reach) - atan2(velocity[1], velocity[0]))
        off = max(-pi / 2.0, min(pi / 2.0, off))
        return 4.0 * self.damping**2 * speed * speed / ahead_m * sin(off)

    def towards(self, here: Vector3, velocity: Vector3, place: Vector3) -> float:
        """Straight to a place."""
        return self.on_course(velocity, atan2(place[1] - here[1], place[0] - here[0]))

    def on_course(self, velocity: Vector3, course_rad: float) -> float:
        """On a course over ground."""
        speed = max(_LEAST_M_S, hypot(velocity[0], velocity[1]))
        off = max(-pi / 2.0, min(pi / 2.0, wrap_pi(course_rad - atan2(velocity[1], velocity[0]))))
        return 4.0 * self.damping**2 * speed * pi / (self.damping * self.period_s) * sin(off)

    def around(self, here: Vector3, velocity: Vector3, centre: Vector3, radius_m: float) -> float:
        """Around a place, clockwise; to the left with a negative radius. From afar it goes to the circle's edge."""
        side, radius = (1.0, radius_m) if radius_m > 0.0 else (-1.0, -radius_m)
        speed = max(_LEAST_M_S, hypot(velocity[0], velocity[1]))
        ahead_m = self.damping * self.period_s * speed / pi
        north, east = here[0] - centre[0], here[1] - centre[1]
        distance = max(1.0, hypot(north, east))
        north, east = north / distance, east / distance
        out_m_s = velocity[0] * north + velocity[1] * east
        round_m_s = side * (velocity[1] * north - velocity[0] * east)
        omega = tau / self.period_s
        back = (distance - radius) * omega * omega + out_m_s * 2.0 * self.damping * omega
        pull = back + max(0.0, round_m_s) * round_m_s / max(0.5 * radius, distance)
        if round_m_s < 0.0:
            pull = max(pull, 0.0)
        if distance > radius + ahead_m:
            # A tangent on the side on which it goes round.
            bearing = atan2(-east, -north)
            return self.on_course(velocity, bearing - side * _asin(min(1.0, radius / distance)))
        return side * pull


def _asin(value: float) -> float:
    return atan2(value, max(1e-9, 1.0 - value * value) ** 0.5)
