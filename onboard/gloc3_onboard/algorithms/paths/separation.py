"""Separation from other vehicles: how fast a vehicle may go on, given where the others are and how they move.

Distances are those of an ellipsoid: `separation_m` to the side counts like `separation_height_m` up or down. Others are
taken to keep their velocity. Of two vehicles one gives way: it plans ahead for `HORIZON_S` with a margin. The other one only
brakes where the separation itself would be lost before it could stop.
"""

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

from gloc3.messages.frames import Vector3
from gloc3.messages.neighbours import Neighbour

HORIZON_S: Final = 8.0
"""How far ahead the vehicle that gives way looks, s."""
STEP_S: Final = 0.25
MARGIN: Final = 1.3
"""The vehicle that gives way keeps so many times the separation."""
SETTLES_S: Final = 0.8
"""Time constant with which a vehicle follows a new speed, s; the limiter's own and the vehicle's."""
STALE_S: Final = 5.0
"""Reports older than this do not count, s."""
DRIFT_M_S: Final = 0.5
"""So much the place of another vehicle is uncertain for each second since its report, m/s."""
SHARES: Final = (1.0, 0.7, 0.4, 0.0)
"""Of the wanted speed, that are tried."""
NEARER_M: Final = 0.05
"""So much nearer than now is not nearer, m."""


class Passage(NamedTuple):
    """What may be done now."""

    share: float = 1.0
    """Of the wanted speed, 0 to 1."""
    name: str = ""
    """The vehicle on account of which it is less; empty where it is not."""
    distance_m: float = math.inf
    """To that vehicle now, m."""
    has_priority: bool = False
    """Whether that vehicle has."""


class SeparationRule(NamedTuple):
    """The distances to keep, and how the vehicle stops."""

    separation_m: float
    separation_height_m: float
    braking_m_s2: float

    def passage(
        self,
        at: Vector3,
        velocity: Vector3,
        wanted: Vector3,
        others: Iterable[Neighbour],
        now_s: float,
    ) -> Passage:
        """The share of a wanted velocity that keeps the separation from all others.

        Args:
            at: the vehicle's position, NED in m.
            velocity: its velocity, NED in m/s.
            wanted: the velocity that it wants.
            others: the other vehicles.
            now_s: the time.
        """
        found = Passage()
        for other in others:
            age_s = now_s - other.t_s
            if self.separation_m > 0.0 and age_s <= STALE_S:
                one = self._passage(at, velocity, wanted, other, max(0.0, age_s))
                found = min(found, one, key=lambda passage: passage.share)
        return found

    def _passage(self, at: Vector3, velocity: Vector3, wanted: Vector3, other: Neighbour, age_s: float) -> Passage:
        scale = self.separation_m / self.separation_height_m
        there = tuple(
            p + v * age_s - own for p, v, own in zip(other.position_ned_m, other.velocity_ned_m_s, at, strict=True)
        )
        now_m = math.hypot(there[0], there[1], there[2] * scale)
        keep_m = (MARGIN if other.has_priority else 1.0) * self.separation_m + DRIFT_M_S * age_s
        horizon_s = HORIZON_S
        if not other.has_priority:
            horizon_s = 1.0 + SETTLES_S + math.hypot(*velocity) / self.braking_m_s2
        enough_m = min(keep_m, now_m - NEARER_M)
        best = Passage()
        most_m = -1.0
        for share in SHARES:
            least_m = self._least_m(there, velocity, wanted, share, other.velocity_ned_m_s, horizon_s)
            if least_m >= enough_m:
                best = Passage(share, other.name, now_m, other.has_priority)
                break
            if least_m > most_m + NEARER_M:
                most_m, best = least_m, Passage(share, other.name, now_m, other.has_priority)
        return best if best.share < 1.0 else Passage()

    def _least_m(
        self,
        there: tuple[float, ...],
        velocity: Vector3,
        wanted: Vector3,
        share: float,
        theirs: Vector3,
        horizon_s: float,
    ) -> float:
        """The least distance within a time, where the vehicle takes a share of the wanted velocity from now."""
        scale = self.separation_m / self.separation_height_m
        least_m = math.inf
        for step in range(1, round(horizon_s / STEP_S) + 1):
            t_s = step * STEP_S
            carried_s = SETTLES_S * (1.0 - math.exp(-t_s / SETTLES_S))
            north, east, down = (
                place + v * t_s - now * carried_s - share * want * (t_s - carried_s)
                for place, v, now, want in zip(there, theirs, velocity, wanted, strict=True)
            )
            least_m = min(least_m, math.hypot(north, east, down * scale))
        return least_m
