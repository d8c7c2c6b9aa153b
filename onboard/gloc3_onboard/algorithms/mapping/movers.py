"""Detection of moving obstacles: hits where a recent scan saw free space."""

import math
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import Vector3

Array = NDArray[np.float64]
Points = list[tuple[float, float]]
BINS: Final = 180
AGE_S: Final = 0.4
"""Least age of the scan that the newest is compared with, s."""
OLDEST_S: Final = 0.8
"""Greatest age of that scan, s."""
THROUGH_M: Final = 0.12
"""Least distance between a point and the hit behind it for which the point counts as free space."""
NOISE_M: Final = 0.05
MOVING_M_S: Final = 0.15
"""Slower motions than this are taken for noise."""
FASTEST_M_S: Final = 1.5
FORESIGHT_S: Final = (0.3, 0.6, 0.9, 1.2, 1.5)
"""What moves is kept away from where it will be then as from where it is."""


class _PastScan(NamedTuple):
    """One scan of before."""

    t_s: float
    at_ne_m: Array
    points_ne_m: Array
    ranges_m: Array
    """To the nearest point in each direction and the two beside it; infinite where nothing was hit."""


class Movers:
    """Keeps recent scans and predicts where moving obstacles will be."""

    def __init__(self) -> None:
        self._polls: deque[_PastScan] = deque()
        self._resets = 0

    def add_scan(self, points_ne_m: Sequence[tuple[float, float]], at: Vector3, t_s: float, resets: int = 0) -> Points:
        """Adds a scan.

        Args:
            points_ne_m: the hits: north and east, in metres.
            at: position of the vehicle.
            t_s: time of the scan.
            resets: number of jumps of the pose; scans from before a jump are dropped.

        Returns:
            Predicted positions of moving obstacles: north and east, in metres.
        """
        points, here = np.array(points_ne_m, np.float64).reshape(-1, 2), np.array(at[:2])
        views = self._polls
        if resets != self._resets or (views and t_s <= views[-1].t_s):
            views.clear()
        self._resets = resets
        while views and t_s - views[0].t_s > OLDEST_S:
            views.popleft()
        while len(views) > 1 and t_s - views[1].t_s >= AGE_S:
            views.popleft()
        soon: Points = []
        if views and t_s - views[0].t_s >= AGE_S and len(views[0].points_ne_m):
            soon = _soon(points, views[0], t_s - views[0].t_s)
        views.append(_PastScan(t_s, here, points, _ranges_m(points - here)))
        return soon


def _soon(points: Array, before: _PastScan, duration_s: float) -> Points:
    """Where the points will be that have come to places which an earlier scan saw through."""
    # Free-space violation: a hit nearer than what the earlier scan saw in that direction.
    offset = points - before.at_ne_m
    came = points[np.hypot(*offset.T) < before.ranges_m[_bins(offset)] - THROUGH_M]
    routes = came[:, None] - before.points_ne_m[None]
    gaps = np.hypot(routes[:, :, 0], routes[:, :, 1])
    nearest = gaps.argmin(axis=1)
    rows = np.arange(len(came))
    gap = gaps[rows, nearest]
    speed = (gap - NOISE_M) / duration_s
    is_moving = speed > MOVING_M_S
    share = np.minimum(speed, FASTEST_M_S)[is_moving] / gap[is_moving]
    velocity = routes[rows, nearest][is_moving] * share[:, None]
    places = np.vstack([came[is_moving] + later_s * velocity for later_s in FORESIGHT_S])
    return [(north, east) for north, east in places.tolist()]


def _bins(offset: Array) -> NDArray[np.intp]:
    return np.floor(np.arctan2(offset[:, 1], offset[:, 0]) * (BINS / (2.0 * math.pi))).astype(np.intp) % BINS


def _ranges_m(offset: Array) -> Array:
    ranges = np.full(BINS, np.inf)
    np.minimum.at(ranges, _bins(offset), np.hypot(*offset.T))
    nearest: Array = np.minimum(ranges, np.minimum(np.roll(ranges, 1), np.roll(ranges, -1)))
    return nearest
