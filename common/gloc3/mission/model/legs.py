"""Straight legs of a path with their duration, and their energy by the platform's power model."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from math import dist, hypot
from typing import Final

import msgspec

from gloc3.messages.frames import Vector3
from gloc3.platform.limits import Limits, Power

ARMING_S: Final = 3.0
"""From the request to the first centimetre of height: arming, spinning up, changing mode."""
TRANSITION_S: Final = 10.0
"""From a hover to wings, and from wings to a hover, with the power of a hover."""
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
    is_on_wings: bool = False
    """Flown on wings by what can hover, too."""

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
        climb_wh = power.climb_w_per_m_s * climbed_m / 3600.0
        if self.is_on_wings:
            return (power.wings_w + power.avionics_w) * self.duration_s / 3600.0 + climb_wh
        steady_w = power.hover_w + power.avionics_w
        return (steady_w * self.duration_s + power.per_m_s_w * across_m) / 3600.0 + climb_wh


class Budget(msgspec.Struct, frozen=True, kw_only=True):
    """Assumptions of a flight's estimate."""

    home_ned_m: Vector3 = (0.0, 0.0, 0.0)
    speed_m_s: float = 1.0
    climb_m_s: float = 1.0
    landing_m_s: float = 0.5
    acceleration_m_s2: float = 1.0
    arming_s: float = ARMING_S
    disarming_s: float = DISARMING_S
    rotors_speed_m_s: float = 0.0
    """Of what has both wings and rotors; 0 for others."""
    wings_from_m: float = 0.0
    """With that: ways that are no shorter are flown on wings, where they do not say."""
    wings_speed_m_s: float = 0.0
    """With that: speed of ways on wings that say none."""

    @classmethod
    def of(cls, limits: Limits, home_ned_m: Vector3) -> "Budget":
        """The budget of a platform."""
        return cls(
            home_ned_m=home_ned_m,
            speed_m_s=limits.speed_m_s,
            climb_m_s=limits.climb_m_s,
            landing_m_s=limits.landing_m_s,
            acceleration_m_s2=limits.acceleration_m_s2,
            rotors_speed_m_s=limits.rotors_speed_m_s,
            wings_from_m=2.0 * limits.transition_m,
            wings_speed_m_s=limits.survey_speed_m_s or limits.speed_m_s,
        )


def climb(start_ned_m: Vector3, end_ned_m: Vector3, budget: Budget) -> FlightLeg:
    """A piece straight up or down."""
    return FlightLeg(start=start_ned_m, end=end_ned_m, duration_s=abs(end_ned_m[2] - start_ned_m[2]) / budget.climb_m_s)


def fly(
    start_ned_m: Vector3, path_ned_m: Iterable[Vector3], speed_m_s: float, rest_s: float, budget: Budget
) -> tuple[FlightLeg, ...]:
    """Legs of a path: each at the requested speed, limited by the platform's climb rate, starting at rest.

    `rest_s` is the time at each waypoint.
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


def fly_by_form(
    start_ned_m: Vector3,
    path_ned_m: Sequence[Vector3],
    speed_m_s: float | None,
    rest_s: float,
    budget: Budget,
    by: str | None = None,
) -> tuple[FlightLeg, ...]:
    """The pieces of a way of what has both wings and rotors, with its transitions; for others that of `fly`.

    Args:
        start_ned_m: where it begins.
        path_ned_m: its places.
        speed_m_s: the speed asked for; None for the usual one.
        rest_s: stay at each waypoint.
        budget: speeds and the like.
        by: `wings` or `rotors`; None for whichever suits its length.
    """
    if budget.rotors_speed_m_s <= 0.0:
        return fly(start_ned_m, path_ned_m, speed_m_s or budget.speed_m_s, rest_s, budget)
    length_m = sum(dist(one, other) for one, other in pairwise([start_ned_m, *path_ned_m]))
    if not (by == "wings" if by is not None else length_m > budget.wings_from_m):
        slow_m_s = min(speed_m_s or budget.rotors_speed_m_s, budget.rotors_speed_m_s)
        return fly(start_ned_m, path_ned_m, slow_m_s, rest_s, budget)
    legs = fly(start_ned_m, path_ned_m, speed_m_s or budget.wings_speed_m_s, rest_s, budget)
    begin = FlightLeg(start=start_ned_m, end=start_ned_m, duration_s=TRANSITION_S)
    end = FlightLeg(start=path_ned_m[-1], end=path_ned_m[-1], duration_s=TRANSITION_S)
    return (begin, *(msgspec.structs.replace(leg, is_on_wings=True) for leg in legs), end)
