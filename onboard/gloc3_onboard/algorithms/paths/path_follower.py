"""Path follower: a target point that moves along a polyline at a set speed."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from gloc3.messages.frames import Vector3

SAME_M: Final = 1e-6
"""Waypoints that are no farther apart are one place."""
REACHED_M: Final = 1e-3
WAITING_SHARE: Final = 0.05
"""Share of the wanted speed below which the point counts as waiting for the vehicle."""
CORNER_S: Final = 0.08
"""A corner is passed no faster than the acceleration could turn the velocity in this time."""
BRAKING_SHARE: Final = 0.7
"""Part of the acceleration that braking is planned with: a vehicle that is braked harder flies past."""
STOPPING_HZ: Final = 3.5
CRAWL_M_S: Final = 0.05
"""Speed of the last centimetres before a stop; before them it is `STOPPING_HZ` times the distance left."""
SHARP: Final = 0.5
"""Where the direction changes by more than this (30 degrees; it is the distance of the unit vectors) is a corner."""
NEARER_M: Final = 0.2
"""Decrease of the distance that shows that a vehicle is still approaching the waiting point."""
LEAD_M: Final = 0.3
LEAD_S: Final = 0.35
"""The point slows down for a vehicle that lags by more than `LEAD_M` plus the distance covered in this time, and waits
at twice that lag."""


class PathLeg(NamedTuple):
    """One straight leg of the path."""

    start: Vector3
    along: Vector3
    """Unit vector."""
    length_m: float
    speed_m_s: float
    end_speed_m_s: float
    """The largest speed at which its end may be passed."""
    waypoint: int
    """Index of the waypoint that it leads to."""
    is_checked: bool
    """Whether the point waits at its end until the vehicle has come near."""


class PathTarget(NamedTuple):
    """The current target: position, velocity and bearing."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    bearing_rad: float | None
    """Of the leg, clockwise from north; None on a vertical leg."""


class PathFollower:
    """Moves a point along waypoints: accelerates, slows down before corners, stops at the end.

    At a corner, a stop and the end it waits until the vehicle is within the acceptance distance.

    Args:
        start_ned_m: position of the vehicle.
        waypoints_ned_m: the waypoints, in order.
        speed_m_s: on the legs.
        acceleration_m_s2: along the path, and in corners.
        hold_s: stop at each waypoint, from the vehicle's arrival.
        climb_m_s: largest vertical speed; steep legs are flown slower.
        acceptance_m: largest distance at which a waypoint counts as reached.
    """

    def __init__(
        self,
        start_ned_m: Vector3,
        waypoints_ned_m: Sequence[Vector3],
        speed_m_s: float,
        acceleration_m_s2: float,
        hold_s: float = 0.0,
        *,
        climb_m_s: float = math.inf,
        acceptance_m: float = 0.25,
    ) -> None:
        self.waited_s = 0.0
        """How long the point has been standing because the vehicle does not come."""
        self.slack_m = 0.0
        """So much farther ahead than usual the point may be, while the vehicle goes around something."""
        self._waypoints = tuple(waypoints_ned_m)
        self._speed_m_s, self._climb_m_s = speed_m_s, climb_m_s
        self._acceleration = acceleration_m_s2
        self._hold_s = hold_s
        self._acceptance_m = acceptance_m
        is_there = math.dist(start_ned_m, self._waypoints[0]) <= SAME_M
        self._rest_s = hold_s if is_there else 0.0
        self._is_waiting = False
        self._nearest_m = math.inf
        """How near the vehicle came to the waypoint at which the point waits for it."""
        self._lay(start_ned_m, list(enumerate(self._waypoints)))
        self.length_m = sum(leg.length_m for leg in self._legs)

    def _lay(self, start: Vector3, path: Sequence[tuple[int, Vector3]]) -> None:
        self._legs = _legs_of(
            start, path, self._speed_m_s, self._climb_m_s, self._acceleration, stops=self._hold_s > 0.0
        )
        self._index, self._on_leg_m, self._now_m_s = 0, 0.0, 0.0

    # --- where it is ---

    @property
    def is_at_end(self) -> bool:
        """Whether the point has come to the last waypoint, the vehicle is near, and both have rested there."""
        return self._index >= len(self._legs) and not self._is_staying

    @property
    def waypoint(self) -> int:
        """Index of the waypoint that is being flown to, or stayed at."""
        index = self._index - self._is_staying
        if not self._legs or index < 0:
            return 0
        return self._legs[min(index, len(self._legs) - 1)].waypoint

    @property
    def _is_staying(self) -> bool:
        """Whether the point stays at a reached waypoint, for the vehicle or for a stop."""
        return self._is_waiting or self._rest_s > 0.0

    @property
    def travelled_m(self) -> float:
        """Distance travelled by the point."""
        left_m = sum(leg.length_m for leg in self._legs[self._index :]) - self._on_leg_m
        return max(0.0, self.length_m - left_m)

    @property
    def progress(self) -> float:
        """Waypoints passed, plus the share of the leg to the next one, out of all: 0 to 1."""
        if self._index >= len(self._legs):
            return 1.0
        leg = self._legs[self._index]
        passed = leg.waypoint + self._on_leg_m / leg.length_m - (0.01 if self._is_waiting else 0.0)
        return max(0.0, passed) / len(self._waypoints)

    # --- moving on ---

    def halt(self) -> None:
        """Restarts from rest, as after a pause."""
        self._now_m_s = self.waited_s = 0.0

    def rejoin(self, position_ned_m: Vector3) -> None:
        """Leads the vehicle back to the point at the path's speed, and continues from there.

        A stop that it has left begins again when it is back.
        """
        self.halt()
        here, is_over = self._here().position_ned_m, self._index >= len(self._legs)
        if math.dist(here, position_ned_m) <= (max(LEAD_M, self._acceptance_m) if is_over else LEAD_M):
            return
        next_waypoint = len(self._waypoints) - 1 if is_over else self._legs[self._index].waypoint
        rest = list(enumerate(self._waypoints))[next_waypoint:]
        here_waypoint = self.waypoint if self._is_staying else next_waypoint
        self._is_waiting, self._rest_s = False, 0.0
        self._lay(position_ned_m, [(here_waypoint, here), *rest])

    def advance(self, duration_s: float, position_ned_m: Vector3) -> PathTarget:
        """Advances the point and returns it."""
        here = self._here().position_ned_m
        behind_m = math.dist(here, position_ned_m)
        if self._is_staying:
            self._stay(duration_s, behind_m)
        elif self._index < len(self._legs):
            self._move(duration_s, behind_m)
            self._count_wait(duration_s, is_moving=self._now_m_s > WAITING_SHARE * self._speed_m_s)
        return self._here()

    def _stay(self, duration_s: float, behind_m: float) -> None:
        """At a waypoint: waits for the vehicle, then rests with it."""
        if behind_m > self._acceptance_m:
            is_nearer = behind_m < self._nearest_m - NEARER_M
            self._nearest_m = behind_m if is_nearer else self._nearest_m
            self._count_wait(duration_s, is_moving=is_nearer)
        else:
            self._is_waiting, self.waited_s = False, 0.0
            self._rest_s -= duration_s

    def _count_wait(self, duration_s: float, *, is_moving: bool) -> None:
        self.waited_s = 0.0 if is_moving else self.waited_s + duration_s

    def _move(self, duration_s: float, behind_m: float) -> None:
        left_s = duration_s
        while left_s > 0.0 and self._index < len(self._legs):
            leg = self._legs[self._index]
            left_m = leg.length_m - self._on_leg_m
            speed = self._speed(leg, left_m, left_s, behind_m)
            self._now_m_s = speed
            if left_m > REACHED_M and speed * left_s < left_m:
                self._on_leg_m += speed * left_s
                return
            left_s -= left_m / speed if speed > 0.0 else left_s
            self._now_m_s = min(speed, leg.end_speed_m_s)
            self._index, self._on_leg_m = self._index + 1, 0.0
            if leg.is_checked:
                is_waypoint = math.dist(self._here().position_ned_m, self._waypoints[leg.waypoint]) <= SAME_M
                self._is_waiting, self._rest_s = behind_m > self._acceptance_m, self._hold_s * is_waypoint
                self._nearest_m = behind_m
                if self._is_staying:
                    self._now_m_s = 0.0
                    return

    def _speed(self, leg: PathLeg, left_m: float, duration_s: float, behind_m: float) -> float:
        """For the next step: near to the wanted one, and such that the end's can still be kept."""
        lead_m = LEAD_M + LEAD_S * leg.speed_m_s + self.slack_m
        wanted = leg.speed_m_s * min(max(2.0 - behind_m / lead_m, 0.0), 1.0)
        change = self._acceleration * duration_s
        speed = min(max(wanted, self._now_m_s - change), self._now_m_s + change)
        is_late = leg.is_checked and behind_m > self._acceptance_m
        end_speed = 0.0 if is_late else leg.end_speed_m_s
        braking = BRAKING_SHARE * self._acceleration
        lost = braking * duration_s
        to_end = math.sqrt(lost * lost + 2.0 * braking * left_m + end_speed**2) - lost
        if leg.end_speed_m_s == 0.0:
            to_end = min(to_end, max(STOPPING_HZ * left_m, CRAWL_M_S))
        return min(speed, to_end)

    def _here(self) -> PathTarget:
        if self._index >= len(self._legs):
            return PathTarget(self._waypoints[-1], (0.0, 0.0, 0.0), self._bearing(len(self._legs) - 1))
        leg, path, speed = self._legs[self._index], self._on_leg_m, self._now_m_s
        n, e, d = leg.along
        position = (leg.start[0] + n * path, leg.start[1] + e * path, leg.start[2] + d * path)
        return PathTarget(position, (n * speed, e * speed, d * speed), self._bearing(self._index - self._is_staying))

    def _bearing(self, index: int) -> float | None:
        if index < 0:
            return None
        north, east, _ = self._legs[index].along
        return math.atan2(east, north) if math.hypot(north, east) > 0.05 else None


def next_ahead(position: Vector3, waypoints: Sequence[Vector3], first: int, within_m: float) -> int:
    """Index of the next waypoint of a vehicle that may have flown on unobserved.

    Args:
        position: position of the vehicle.
        waypoints: all of them.
        first: index of the last known next one; at least 1.
        within_m: largest distance from a later leg at which the vehicle counts as on it.
    """
    while first + 1 < len(waypoints):
        before, here, after = waypoints[first - 1 : first + 2]
        onward_m = _along_m(here, after, position)
        away_m = math.sqrt(max(0.0, math.dist(here, position) ** 2 - onward_m**2))
        if _along_m(before, here, position) < math.dist(before, here) or onward_m <= 0.0 or away_m > within_m:
            break
        first += 1
    return first


def _along_m(start: Vector3, end: Vector3, position: Vector3) -> float:
    """How far a position is from the start, in the direction of the end."""
    length_m = math.dist(start, end)
    if length_m <= SAME_M:
        return 0.0
    return sum((p - s) * (e - s) for p, s, e in zip(position, start, end, strict=True)) / length_m


def _legs_of(
    start: Vector3,
    path: Sequence[tuple[int, Vector3]],
    speed_m_s: float,
    climb_m_s: float,
    acceleration_m_s2: float,
    *,
    stops: bool,
) -> list[PathLeg]:
    """The legs, without those of no length; from the last to the first, since each must be able to end as it shall."""
    pieces: list[tuple[Vector3, Vector3, float, int]] = []
    at = start
    for waypoint, place in path:
        length_m = math.dist(at, place)
        if length_m > SAME_M:
            along = ((place[0] - at[0]) / length_m, (place[1] - at[1]) / length_m, (place[2] - at[2]) / length_m)
            pieces.append((at, along, length_m, waypoint))
            at = place
    legs: list[PathLeg] = []
    next_speed, next_along = 0.0, None
    for begin, along, length_m, waypoint in reversed(pieces):
        speed = min(speed_m_s, climb_m_s / abs(along[2])) if along[2] else speed_m_s
        end_speed, is_checked = 0.0, True
        if next_along is not None and not stops:
            turn = math.dist(along, next_along)
            in_corner = CORNER_S * acceleration_m_s2 / turn if turn > SAME_M else math.inf
            end_speed, is_checked = min(speed, next_speed, in_corner), turn > SHARP
        legs.append(PathLeg(begin, along, length_m, speed, end_speed, waypoint, is_checked))
        # No faster into this leg than one can be slow enough again at its end.
        next_speed = min(speed, math.sqrt(end_speed**2 + 2.0 * BRAKING_SHARE * acceleration_m_s2 * length_m))
        next_along = along
    return legs[::-1]
