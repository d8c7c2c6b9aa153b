"""Obstacles as points in the plane: clearance, free distance and detours.

All positions are (north, east, …) in NED. Height is ignored: a hit of a level scanner is treated as a vertical post.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from gloc3.messages.frames import Vector3

FARTHEST_M: Final = 8.0
"""What is farther away does not matter yet."""
SIDEWAYS_RAD: Final = math.radians(10.0)
WIDEST_RAD: Final = math.radians(110.0)
"""Directions around the wanted one are examined in steps of `SIDEWAYS_RAD`, up to this angle."""
SAME_SIDE_RAD: Final = math.radians(35.0)
"""Extra turn accepted to pass an obstacle on the side that was chosen first."""
LOOK_AHEAD_M: Final = 1.2
STUCK_M: Final = 0.4
STUCK_S: Final = 3.0
"""Time without moving `STUCK_M` after which the chosen side counts as a dead end, s."""
CLOSED_S: Final = 12.0
"""Time for which the other side is then tried, s."""
SLACK_M: Final = 0.1
"""So much nearer than is wanted the point may slide along an obstacle; from nearer still it goes away at once."""
TUBE_M: Final = 0.03
"""Tolerance on the width of a path, without which sliding along a wall would end at its roughness."""
REFUGE_STEPS_M: Final = (0.3, 0.6, 1.2)
REFUGES: Final = 24
"""Number of directions in which a refuge is searched, at each of the distances above."""


class ObstacleField:
    """The points of one scan around a vehicle, and the distance to keep from them.

    Args:
        points_ne_m: the obstacles.
        around: position of the vehicle.
        keep_m: distance to keep.
        soon_ne_m: predicted positions of moving obstacles.
    """

    def __init__(
        self,
        points_ne_m: Sequence[tuple[float, float]],
        around: Vector3,
        keep_m: float,
        soon_ne_m: Sequence[tuple[float, float]] = (),
    ) -> None:
        points = np.array([*points_ne_m, *soon_ne_m], np.float64).reshape(-1, 2)
        near = np.hypot(*(points - around[:2]).T) < FARTHEST_M
        self._points = points[near]
        self.keep_m: Final = keep_m
        self.present: Final[ObstacleField] = ObstacleField(points_ne_m, around, keep_m) if soon_ne_m else self
        """Present obstacles without predictions: a vehicle that stands in a predicted position may leave it in any
        direction."""

    @property
    def is_empty(self) -> bool:
        """Whether nothing is near."""
        return not len(self._points)

    def clearance_m(self, place: Vector3) -> float:
        """Distance to the nearest point."""
        if self.is_empty:
            return math.inf
        return float(np.sqrt(((self._points - place[:2]) ** 2).sum(axis=1).min()))

    def leg_clearance_m(self, start: Vector3, end: Vector3) -> float:
        """Smallest clearance along a straight leg."""
        if self.is_empty:
            return math.inf
        along = np.subtract(end[:2], start[:2])
        square = float(along @ along)
        offset = self._points - start[:2]
        if square > 0.0:
            share = np.clip(offset @ along / square, 0.0, 1.0)
            offset = offset - share[:, None] * along
        return float(np.sqrt((offset**2).sum(axis=1).min()))

    def away(self, place: Vector3) -> tuple[float, float]:
        """Unit vector away from the nearest point; (0, 0) where there is none."""
        if self.is_empty:
            return (0.0, 0.0)
        offset = place[:2] - self._points
        distance = np.hypot(*offset.T)
        nearest = int(np.argmin(distance))
        if distance[nearest] < 1e-6:
            return (0.0, 0.0)
        north, east = (offset[nearest] / distance[nearest]).tolist()
        return (north, east)

    def pushed_out(self, place: Vector3, at: Vector3) -> Vector3:
        """A clear place near the wanted one; the present place if none is found."""
        for _ in range(12):
            missing_m = self.keep_m - self.clearance_m(place)
            if missing_m <= 0.0:
                return place
            north, east = self.away(place)
            place = (place[0] + (missing_m + 0.01) * north, place[1] + (missing_m + 0.01) * east, place[2])
        return (at[0], at[1], place[2])

    def refuge(self, at: Vector3) -> Vector3:
        """The nearest clear place around, or else the one with the largest clearance."""
        angles = np.arange(REFUGES) * (2.0 * math.pi / REFUGES)
        routes = np.vstack([step_m * np.column_stack((np.cos(angles), np.sin(angles))) for step_m in REFUGE_STEPS_M])
        clearance = np.array([self.clearance_m((at[0] + n, at[1] + e, at[2])) for n, e in routes.tolist()])
        worth = np.minimum(clearance, self.keep_m) - 0.1 * np.hypot(*routes.T)
        north, east = routes[int(np.argmax(worth))].tolist()
        return (at[0] + north, at[1] + east, at[2])

    def free_m(self, at: Vector3, headings_rad: Sequence[float]) -> list[float]:
        """Free distance in each direction, for a path as wide as the distance to keep; infinite where nothing is."""
        if self.is_empty:
            return [math.inf] * len(headings_rad)
        now_m, least_m = self.clearance_m(at), self.keep_m - SLACK_M
        width_m = max(min(self.keep_m, now_m) - TUBE_M, least_m) if now_m > least_m else now_m
        angles = np.array(headings_rad)
        offset = self._points - at[:2]
        c, s = np.cos(angles), np.sin(angles)
        along = np.outer(offset[:, 0], c) + np.outer(offset[:, 1], s)
        across = np.outer(offset[:, 1], c) - np.outer(offset[:, 0], s)
        contact = along - np.sqrt(np.maximum(width_m**2 - across**2, 0.0))
        blocked = np.where((along > 0.0) & (np.abs(across) < width_m), contact, np.inf)
        return [max(0.0, float(free)) for free in blocked.min(axis=0)]


class Detour:
    """Chooses a direction around obstacles, and stays with the chosen side."""

    def __init__(self) -> None:
        self._side = self._closed = 0
        self._closed_until_s = -math.inf
        self._mark: tuple[Vector3, float] | None = None

    def heading(
        self, field: ObstacleField, at: Vector3, wanted_rad: float, distance_m: float, now_s: float
    ) -> tuple[float, float]:
        """The free direction nearest to the wanted one, and its free distance.

        Args:
            field: the obstacles.
            at: position of the vehicle.
            wanted_rad: direction of the target, clockwise from north.
            distance_m: of the target.
            now_s: the time.
        """
        turns = [0.0]
        for number in range(1, round(WIDEST_RAD / SIDEWAYS_RAD) + 1):
            turns += [number * SIDEWAYS_RAD, -number * SIDEWAYS_RAD]
        needed_m = min(distance_m, LOOK_AHEAD_M)
        free = field.free_m(at, [wanted_rad + turn for turn in turns])
        if free[0] >= needed_m:
            self._side, self._mark = 0, None
            return wanted_rad, free[0]
        self._watch(at, now_s)
        choices = [
            (self._cost(turn, now_s), turn, free_m)
            for turn, free_m in zip(turns, free, strict=True)
            if free_m >= needed_m
        ]
        if not choices:
            return wanted_rad, free[0]
        _, turn, free_m = min(choices)
        self._side = 1 if turn > 0.0 else -1
        return wanted_rad + turn, free_m

    def _watch(self, at: Vector3, now_s: float) -> None:
        """Closes the side that is a dead end."""
        if self._mark is None or math.dist(at[:2], self._mark[0][:2]) > STUCK_M:
            self._mark = (at, now_s)
        elif now_s - self._mark[1] > STUCK_S:
            self._mark = (at, now_s)
            self._closed = self._side or -self._closed or 1
            self._side, self._closed_until_s = -self._closed, now_s + CLOSED_S

    def _cost(self, turn: float, now_s: float) -> float:
        is_closed = turn * self._closed > 0.0 and now_s < self._closed_until_s
        return abs(turn) + (SAME_SIDE_RAD if turn * self._side < 0.0 else 0.0) + (math.pi if is_closed else 0.0)
