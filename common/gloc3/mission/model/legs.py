"""Straight pieces of a flight with the time that each takes, and what they cost by the platform's power model."""

from collections.abc import Iterable
from math import dist, hypot
from typing import Final

import msgspec

from gloc3.messages.frames import Vector3
from gloc3.platform.limits import Limits, Power

ARMING_S: Final = 3.0
"""From the request to the first centimetre of height: arming, spinning up, changing mode."""
DISARMING_S: Final = 3.0
"""From touching the ground to disarmed."""
_ENOUGH_M: Final = 1e-6


class FlightLeg(msgspec.Struct, frozen=True, kw_only=True):
    """A straight piece of a flight, or a stay where both ends are one."""

    start: Vector3
    """NED in metres."""
    end: Vector3
    """NED in metres."""
    duration_s: float
    waypoint: int | None = None
    """Index of the waypoint that it leads to."""

    @property
    def length_m(self) -> float:
        """Distance between the ends."""
        return dist(self.start, self.end)

    def energy_wh(self, power: Power) -> float:
        """Energy of the piece: hover and avionics all the time, more for speed and for climbing."""
        if self.duration_s <= 0.0:
            return 0.0
        across_m = hypot(self.end[0] - self.start[0], self.end[1] - self.start[1])
        climbed_m = max(0.0, self.start[2] - self.end[2])
        steady_w = power.hover_w + power.avionics_w
        return (steady_w * self.duration_s + power.per_m_s_w * across_m + power.climb_w_per_m_s * climbed_m) / 3600.0


class Budget(msgspec.Struct, frozen=True, kw_only=True):
    """Assumptions of a flight's estimate."""

    home_ned_m: Vector3 = (0.0, 0.0, 0.0)
    speed_m_s: float = 1.0
    climb_m_s: float = 1.0
    landing_m_s: float = 0.5
    acceleration_m_s2: float = 1.0
    arming_s: float = ARMING_S
    disarming_s: float = DISARMING_S

    @classmethod
    def of(cls, limits: Limits, home_ned_m: Vector3) -> "Budget":
        """The budget of a platform."""
        return cls(
            home_ned_m=home_ned_m,
            speed_m_s=limits.speed_m_s,
            climb_m_s=limits.climb_m_s,
            landing_m_s=limits.landing_m_s,
            acceleration_m_s2=limits.acceleration_m_s2,
        )


def climb(start_ned_m: Vector3, end_ned_m: Vector3, budget: Budget) -> FlightLeg:
    """A piece straight up or down."""
    return FlightLeg(start=start_ned_m, end=end_ned_m, duration_s=abs(end_ned_m[2] - start_ned_m[2]) / budget.climb_m_s)


def fly(
    start_ned_m: Vector3, path_ned_m: Iterable[Vector3], speed_m_s: float, rest_s: float, budget: Budget
) -> tuple[FlightLeg, ...]:
    """The pieces of a way: each at the speed asked for, no faster than the platform climbs, begun from rest.

    `rest_s` is the time that the vehicle stays at each waypoint.
    """
    legs: list[FlightLeg] = []
    here = start_ned_m
    for index, point in enumerate(path_ned_m):
        length_m = dist(here, point)
        if length_m > _ENOUGH_M:
            speeding_up_s = speed_m_s / budget.acceleration_m_s2
            duration_s = max(length_m / speed_m_s, abs(point[2] - here[2]) / budget.climb_m_s) + speeding_up_s
            legs.append(FlightLeg(start=here, end=point, duration_s=duration_s, waypoint=index))
        if rest_s > 0.0:
            legs.append(FlightLeg(start=point, end=point, duration_s=rest_s, waypoint=index))
        here = point
    return tuple(legs)
