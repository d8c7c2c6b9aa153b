"""Path guidance shared by a plane's modes: bank along a line or around a point, and heights."""

from math import atan, cos, hypot, isnan, nan, sin
from typing import Final

from gloc3.messages.frames import GRAVITY_M_S2, Vector3
from gloc3_sitl.autopilot.control.lateral import LateralGuidance
from gloc3_sitl.autopilot.control.setpoint import WingSetpoint
from gloc3_sitl.autopilot.craft import Craft

_ROUND_SHARE: Final = 1.3
"""Distance to the centre, in radii, within which the vehicle counts as on its circle."""


class PlanePath:
    """Leads one plane; its places are NED."""

    def __init__(self, craft: Craft) -> None:
        self._craft: Final = craft
        self.airspeed_m_s = nan
        """NaN is that of cruise."""
        self._begin: Vector3 = craft.estimator.inertial.position_ned_m
        self.target: Vector3 = self._begin

    def _bank(self, right_m_s2: float) -> float:
        most = self._craft.tuning.wings.roll_max_rad
        return max(-most, min(most, atan(right_m_s2 / GRAVITY_M_S2)))

    def _guide(self) -> LateralGuidance:
        gains = self._craft.tuning.wings
        return LateralGuidance(gains.guidance_s, gains.guidance_damping)

    def head_for(self, target: Vector3, start: Vector3 | None = None) -> None:
        """Sets the next position and the start of the line to it; by default here."""
        here = self._craft.estimator.inertial.position_ned_m
        self._begin, self.target = here if start is None else start, target

    def follow(self) -> WingSetpoint:
        """Along the line, at the height of its end."""
        inertial = self._craft.estimator.inertial
        right = self._guide().along(inertial.position_ned_m, inertial.velocity_ned_m_s, self._begin, self.target)
        return WingSetpoint(roll_rad=self._bank(right), down_m=self.target[2], airspeed_m_s=self.airspeed_m_s)

    def on_slope(self) -> WingSetpoint:
        """Along the line, with its height at each place."""
        slope = (self._begin[2] - self.target[2]) / max(1.0, self.length_m)
        flat = self.follow()
        vn, ve, _ = self._craft.estimator.inertial.velocity_ned_m_s
        return WingSetpoint(
            roll_rad=flat.roll_rad,
            down_m=self.target[2] + slope * self.left_m,
            climb_m_s=slope * hypot(vn, ve),
            airspeed_m_s=flat.airspeed_m_s,
        )

    @property
    def length_m(self) -> float:
        """Horizontal length of the line, m."""
        return hypot(self.target[0] - self._begin[0], self.target[1] - self._begin[1])

    @property
    def left_m(self) -> float:
        """Way along the line to its end; negative beyond it."""
        n, e, _ = self._craft.estimator.inertial.position_ned_m
        north, east = self.target[0] - self._begin[0], self.target[1] - self._begin[1]
        length = hypot(north, east)
        if length < 1.0:
            return hypot(self.target[0] - n, self.target[1] - e)
        return ((self.target[0] - n) * north + (self.target[1] - e) * east) / length

    def is_there(self, within_m: float) -> bool:
        """Whether it is that near to the target, or has passed it."""
        return self.distance_m(self.target) < within_m or self.left_m < 0.0

    def distance_m(self, place: Vector3) -> float:
        """On the map."""
        n, e, _ = self._craft.estimator.inertial.position_ned_m
        return hypot(place[0] - n, place[1] - e)

    def circle(self, centre: Vector3, radius_m: float) -> WingSetpoint:
        """Around a place, at its height."""
        inertial = self._craft.estimator.inertial
        right = self._guide().around(inertial.position_ned_m, inertial.velocity_ned_m_s, centre, radius_m)
        return WingSetpoint(roll_rad=self._bank(right), down_m=centre[2], airspeed_m_s=self.airspeed_m_s)

    def is_round(self, centre: Vector3, radius_m: float) -> bool:
        """Whether it goes round already."""
        return self.distance_m(centre) < _ROUND_SHARE * abs(radius_m)

    def on_course(self, course_rad: float, down_m: float) -> WingSetpoint:
        """On a course over ground, at a height."""
        right = self._guide().on_course(self._craft.estimator.inertial.velocity_ned_m_s, course_rad)
        return WingSetpoint(roll_rad=self._bank(right), down_m=down_m, airspeed_m_s=self.airspeed_m_s)


def beyond(place: Vector3, course_rad: float, distance_m: float, height_m: float = 0.0) -> Vector3:
    """A position at a distance on a course, and at a height above."""
    return (place[0] + distance_m * cos(course_rad), place[1] + distance_m * sin(course_rad), place[2] - height_m)


def circle_of(radius_m: float, usual_m: float) -> float:
    """The radius, or the default without one."""
    return usual_m if isnan(radius_m) or radius_m == 0.0 else radius_m
