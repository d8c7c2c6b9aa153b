"""What a sensor with a narrow view has seen around the vehicle: kept until it is seen through, or too long ago."""

from math import pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import LevelPoints

CELL_M: Final = 0.1
"""Points in a cell of this side are one thing."""
BINS: Final = 180
"""Directions in which it is known how far the sensor sees through."""
BEFORE_M: Final = 0.3
"""What is at most so far before the farthest that was seen in a direction may be what was seen."""


class ObstacleMemory:
    """Obstacles in the plane, each with the time at which it was seen last.

    Args:
        keep_s: time after which an obstacle is dropped that is not seen again.
        most_m: distance from the vehicle beyond which it is dropped.
        band_m: so far above and below the vehicle something is an obstacle.
        fewest: points in a cell that make an obstacle; fewer are noise.
    """

    def __init__(self, keep_s: float, most_m: float, band_m: float, fewest: int) -> None:
        self._keep_s, self._most_m, self._band_m, self._fewest = keep_s, most_m, band_m, fewest
        self._places: Array = np.zeros((0, 2))
        self._seen_s: Array = np.zeros(0)

    def add(self, seen: LevelPoints, pose: Planar, t_s: float) -> Array:
        """Adds what was seen at a time.

        Args:
            seen: the points.
            pose: pose of the body: north, east, heading.
            t_s: the time.

        Returns:
            The directions that were seen, in radians clockwise from ahead of the body.
        """
        offset = seen.points_m - seen.origin_m
        away_m, bins, rise_m = np.hypot(offset[:, 0], offset[:, 1]), _bins(offset), np.abs(seen.points_m[:, 2])
        # A ray to something above or below sees through the band only as far as it is in it.
        through_m = np.zeros(BINS)
        np.maximum.at(through_m, bins, away_m * np.minimum(1.0, self._band_m / np.maximum(rise_m, 1e-6)))
        self._drop(pose, seen.origin_m, through_m, t_s)
        is_near = ~seen.is_floor & (rise_m <= self._band_m) & (away_m <= self._most_m)
        cells = _cells(pose.apply(seen.points_m[is_near, :2]))
        keys, first, counts = np.unique(_keys(cells), return_index=True, return_counts=True)
        is_thing = counts >= self._fewest
        is_other = ~np.isin(_keys(_cells(self._places)), keys[is_thing])
        self._places = np.vstack((self._places[is_other], (cells[first[is_thing]] + 0.5) * CELL_M))
        self._seen_s = np.concatenate((self._seen_s[is_other], np.full(np.count_nonzero(is_thing), t_s)))
        return np.asarray((np.flatnonzero(through_m) + 0.5) * (2.0 * pi / BINS), np.float64)

    def around(self, pose: Planar) -> Array:
        """The obstacles, shape (n, 2): forward and right of the body, in metres."""
        return pose.inverse().apply(self._places)

    def clear(self) -> None:
        """Drops everything."""
        self._places, self._seen_s = np.zeros((0, 2)), np.zeros(0)

    def _drop(self, pose: Planar, origin_m: Array, through_m: Array, t_s: float) -> None:
        offset = self.around(pose) - origin_m[:2]
        away_m = np.hypot(*offset.T)
        is_kept = (t_s - self._seen_s <= self._keep_s) & (away_m <= self._most_m)
        is_kept &= away_m >= through_m[_bins(offset)] - BEFORE_M
        self._places, self._seen_s = self._places[is_kept], self._seen_s[is_kept]


def _bins(offset: Array) -> NDArray[np.intp]:
    return np.floor(np.arctan2(offset[:, 1], offset[:, 0]) * (BINS / (2.0 * pi))).astype(np.intp) % BINS


def _cells(places_m: Array) -> NDArray[np.int64]:
    return np.floor(places_m / CELL_M).astype(np.int64)


def _keys(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """One number a cell."""
    return cells[:, 0] * (1 << 32) + cells[:, 1]
