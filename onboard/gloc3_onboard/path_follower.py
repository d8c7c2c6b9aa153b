"""A point that moves along a polyline at a wanted speed: what the waypoint controller has the vehicle follow."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from gloc3.frames import Vector3

LEAD_M: Final = 0.6
"""The point waits for a vehicle that is farther behind than this."""
SAME_M: Final = 1e-6


class Leg(NamedTuple):
    """One straight piece of the way."""

    start: Vector3
    along: Vector3
    """Unit vector."""
    length_m: float
    start_s_m: float
    """Way from the polyline's begin to the leg's."""
    end_speed_m_s: float
    """The largest speed at which its end may be passed."""
    waypoint: int
    """Index of the waypoint at its end."""


class Target(NamedTuple):
    """Where the vehicle shall be now."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    bearing_rad: float | None
    """Of the leg, clockwise from north; None on a vertical leg."""


class PathFollower:
    """Moves a point along waypoints: accelerates, slows down before corners, stops at the end.

    Args:
        start_ned_m: where the vehicle is.
        waypoints_ned_m: where it shall pass, in their order.
        speed_m_s: on the legs.
        acceleration_m_s2: along the way, and what corners may ask for.
        hold_s: rest at each waypoint.
    """

    def __init__(
        self,
        start_ned_m: Vector3,
        waypoints_ned_m: Sequence[Vector3],
        speed_m_s: float,
        acceleration_m_s2: float,
        hold_s: float = 0.0,
    ) -> None:
        self._speed_m_s = speed_m_s
        self._acceleration = acceleration_m_s2
        self._hold_s = hold_s
        self._legs = _legs_of(start_ned_m, waypoints_ned_m, speed_m_s, stops=hold_s > 0.0)
        self._end = waypoints_ned_m[-1]
        self._index = 0
        self._on_leg_m = 0.0
        self._now_m_s = 0.0
        self._rest_s = 0.0
        self.length_m = sum(leg.length_m for leg in self._legs)

    @property
    def is_at_end(self) -> bool:
        """Whether the point has come to the last waypoint and rested there."""
        return self._index >= len(self._legs) and self._rest_s <= 0.0

    @property
    def waypoint(self) -> int:
        """Index of the waypoint that is being flown to."""
        return self._legs[min(self._index, len(self._legs) - 1)].waypoint if self._legs else 0

    @property
    def travelled_m(self) -> float:
        """Way made by the point."""
        if self._index >= len(self._legs):
            return self.length_m
        return self._legs[self._index].start_s_m + self._on_leg_m

    def halt(self) -> None:
        """Begins again from rest, as after a pause."""
        self._now_m_s = 0.0

    def advance(self, duration_s: float, position_ned_m: Vector3) -> Target:
        """Moves the point on and says where it is."""
        if self._rest_s > 0.0:
            self._rest_s -= duration_s
            return self._here()
        if self._index < len(self._legs):
            self._move(duration_s, math.dist(self._here().position_ned_m, position_ned_m))
        return self._here()

    def _move(self, duration_s: float, behind_m: float) -> None:
        leg = self._legs[self._index]
        left_m = leg.length_m - self._on_leg_m
        allowed = min(self._speed_m_s, math.sqrt(leg.end_speed_m_s**2 + 2.0 * self._acceleration * left_m))
        if behind_m > LEAD_M:
            allowed = 0.0
        change = self._acceleration * duration_s
        self._now_m_s = min(max(allowed, self._now_m_s - change), self._now_m_s + change)
        self._now_m_s = min(self._now_m_s, max(allowed, 0.0)) if allowed else max(self._now_m_s, 0.0)
        step_m = self._now_m_s * duration_s
        # The last steps before a stop would become ever shorter; a crawl ends them.
        step_m = max(step_m, min(0.05 * self._speed_m_s * duration_s, left_m)) if behind_m <= LEAD_M else step_m
        while step_m >= left_m - SAME_M:
            step_m -= left_m
            self._index += 1
            self._on_leg_m = 0.0
            if self._hold_s > 0.0:
                self._rest_s, self._now_m_s = self._hold_s, 0.0
                return
            if self._index >= len(self._legs):
                self._now_m_s = 0.0
                return
            left_m = self._legs[self._index].length_m
            step_m = min(max(step_m, 0.0), left_m)
            self._now_m_s = min(self._now_m_s, self._legs[self._index - 1].end_speed_m_s)
            if step_m <= 0.0:
                break
        self._on_leg_m += max(step_m, 0.0)

    def _here(self) -> Target:
        if self._index >= len(self._legs):
            return Target(self._end, (0.0, 0.0, 0.0), self._bearing(len(self._legs) - 1))
        leg, way, speed = self._legs[self._index], self._on_leg_m, self._now_m_s
        n, e, d = leg.along
        position = (leg.start[0] + n * way, leg.start[1] + e * way, leg.start[2] + d * way)
        return Target(position, (n * speed, e * speed, d * speed), self._bearing(self._index))

    def _bearing(self, index: int) -> float | None:
        if index < 0:
            return None
        north, east, _ = self._legs[index].along
        return math.atan2(east, north) if math.hypot(north, east) > 0.05 else None


def _legs_of(start: Vector3, waypoints: Sequence[Vector3], speed_m_s: float, *, stops: bool) -> list[Leg]:
    """The legs, without those of no length."""
    pieces: list[tuple[Vector3, Vector3, float, int]] = []
    at = start
    for index, waypoint in enumerate(waypoints):
        length_m = math.dist(at, waypoint)
        if length_m > SAME_M:
            along = tuple((b - a) / length_m for a, b in zip(at, waypoint, strict=True))
            pieces.append((at, (along[0], along[1], along[2]), length_m, index))
        at = waypoint
    legs: list[Leg] = []
    way_m = 0.0
    for number, (begin, along, length_m, index) in enumerate(pieces):
        is_last = number == len(pieces) - 1
        turn = 0.0 if is_last else sum(a * b for a, b in zip(along, pieces[number + 1][1], strict=True))
        end_speed = 0.0 if is_last or stops else speed_m_s * max(0.0, turn) ** 4
        legs.append(Leg(begin, along, length_m, way_m, end_speed, index))
        way_m += length_m
    return legs
