"""Line-of-sight guidance: the heading that brings a vehicle onto a straight path and holds it in a current."""

from math import atan, atan2, cos, hypot, inf, sin, sqrt
from typing import Final, NamedTuple

from gloc3.messages.frames import Vector3, wrap_pi

_LEAST_LOOKAHEAD_M: Final = 0.3


class Guidance(NamedTuple):
    """Result of the guidance."""

    heading_rad: float
    """To be steered, clockwise from north."""
    cross_track_m: float
    """To the right of the path."""
    left_m: float
    """Way to its end, along it; negative beyond."""


class LineOfSight:
    """Steers towards a point on the path, a lookahead ahead of the vehicle, and corrects for current.

    The integral line of sight of Børhaug, Pavlov and Pettersen (2008), as in Fossen 2021, section 12.5: the heading is
    `course - atan((y + s) / D)` with `ds/dt = k y D^2 / (D^2 + (y + s)^2)`; s settles where the crab angle `atan(s /
    D)` compensates the drift. It grows slowly far from the path, so that it does not wind up.

    Args:
        integral: k, in 1/s: 0 for vehicles that do not drift; for others less than a quarter of speed over lookahead.
    """

    def __init__(self, integral: float = 0.0) -> None:
        self._integral: Final = integral
        self._start: Vector3 = (0.0, 0.0, 0.0)
        self._along = (1.0, 0.0)
        self._length_m = 0.0
        self._course_rad = 0.0
        self._sum_m = 0.0

    @property
    def course_rad(self) -> float:
        """Bearing of the path."""
        return self._course_rad

    @property
    def crab_m(self) -> float:
        """Lateral offset steered for at the lookahead to compensate the drift."""
        return self._sum_m

    def follow(self, start_ned_m: Vector3, end_ned_m: Vector3, *, keeps_drift: bool = False) -> None:
        """Sets the path; with `keeps_drift`, for a path in much the same direction, the drift estimate is kept."""
        north, east = end_ned_m[0] - start_ned_m[0], end_ned_m[1] - start_ned_m[1]
        self._length_m = hypot(north, east)
        if self._length_m > 0.0:
            self._along = (north / self._length_m, east / self._length_m)
            self._course_rad = atan2(east, north)
        self._start = start_ned_m
        if not keeps_drift:
            self._sum_m = 0.0

    def update(self, position_ned_m: Vector3, lookahead_m: float, duration_s: float) -> Guidance:
        """Computes the heading to steer.

        Args:
            position_ned_m: position of the vehicle.
            lookahead_m: distance ahead on the path of the target point: the shorter, the tighter it turns.
            duration_s: since the last update; 0 while the vehicle does not follow.
        """
        north, east = position_ned_m[0] - self._start[0], position_ned_m[1] - self._start[1]
        ahead, right = self._along
        cross = east * ahead - north * right
        left = self._length_m - north * ahead - east * right
        lookahead = max(lookahead_m, _LEAST_LOOKAHEAD_M)
        aside = cross + self._sum_m
        if self._integral > 0.0:
            self._sum_m += self._integral * duration_s * cross * lookahead**2 / (lookahead**2 + aside**2)
            self._sum_m = max(-2.0 * lookahead, min(2.0 * lookahead, self._sum_m))
        return Guidance(wrap_pi(self._course_rad - atan(aside / lookahead)), cross, left)


def slowed_m_s(speed_m_s: float, left_m: float, end_speed_m_s: float, braking_m_s2: float) -> float:
    """The speed at which a vehicle may still go, so far before a place that it shall pass at a speed."""
    return min(speed_m_s, sqrt(end_speed_m_s**2 + 2.0 * braking_m_s2 * max(left_m, 0.0)))


def corner_speed_m_s(turn_rad: float, within_m: float, turn_rate_rad_s: float) -> float:
    """How fast a corner can be turned by an arc that leaves it by no more than a distance; infinite where it is straight.

    The arc that touches both legs leaves the corner by `R (1 / cos(turn / 2) - 1)`, and is driven at `R` times the rate.
    """
    half = min(0.5 * abs(turn_rad), 1.5)
    excess = 1.0 / cos(half) - 1.0
    return inf if excess < 1e-3 else turn_rate_rad_s * within_m / excess


def heading_vector(heading_rad: float, speed_m_s: float) -> Vector3:
    """A velocity over ground, NED."""
    return (speed_m_s * cos(heading_rad), speed_m_s * sin(heading_rad), 0.0)
