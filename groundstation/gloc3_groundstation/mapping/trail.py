"""A vehicle's trail over hours in bounded memory: recent points as received, older ones thinned.

Older points are thinned by Douglas and Peucker's rule (Cartographica 10, 1973): what is left out lies within a tolerance
of the line that is left. When too many remain all the same, the tolerance is doubled. A row of NaN is a gap.
"""

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import Vector3

Points = NDArray[np.float64]
"""Rows of `x_m, y_m, height_m, t_s`."""

FRESH: Final = 512
"""Points that are kept as they came, before they are thinned."""
MOST: Final = 4096
"""Points that are kept of the time before."""
FIRST_TOLERANCE_M: Final = 0.03
STANDING_M: Final = 0.02
"""A vehicle that moves less adds no point."""
GAP: Final = (np.nan, np.nan, np.nan, np.nan)


class Trail:
    """The way of one vehicle, in the frame in which it tells its position."""

    def __init__(self) -> None:
        self.tolerance_m = FIRST_TOLERANCE_M
        """How far the thinned way may be from what was told."""
        self._older: Points = np.empty((0, 4))
        self._fresh: Points = np.empty((FRESH, 4))
        self._count = 0

    def __len__(self) -> int:
        return len(self._older) + self._count

    @property
    def points(self) -> Points:
        """All points, the oldest first."""
        return np.concatenate((self._older, self._fresh[: self._count]))

    @property
    def bytes(self) -> int:
        """The memory it takes."""
        return self._older.nbytes + self._fresh.nbytes

    def add(self, t_s: float, position_m: Vector3) -> None:
        """Adds a point; one at the place of the last takes its place in time."""
        if self._count >= 2:
            last = self._fresh[self._count - 1, :3]
            before = self._fresh[self._count - 2, :3]
            if _near(last, position_m) and _near(before, position_m):
                self._fresh[self._count - 1, 3] = t_s
                return
        self._append((*position_m, t_s))

    def interrupt(self) -> None:
        """Nothing is known of the way from here to the next point."""
        if self._count and not np.isnan(self._fresh[self._count - 1, 0]):
            self._append(GAP)

    def clear(self) -> None:
        """Forgets the way."""
        self._older, self._count, self.tolerance_m = np.empty((0, 4)), 0, FIRST_TOLERANCE_M

    def _append(self, row: tuple[float, float, float, float]) -> None:
        if self._count == FRESH:
            self._settle()
        self._fresh[self._count] = row
        self._count += 1

    def _settle(self) -> None:
        """Thins the older half of the fresh points, and all old ones where these have become too many."""
        half = FRESH // 2
        thin = thinned(self._fresh[: half + 1], self.tolerance_m)[:-1]
        self._older = np.concatenate((self._older, thin))
        self._fresh[: FRESH - half] = self._fresh[half:].copy()
        self._count -= half
        while len(self._older) > MOST:
            self.tolerance_m *= 2.0
            self._older = thinned(self._older, self.tolerance_m)
            if self.tolerance_m > 1e6:  # nothing but gaps
                self._older = self._older[-MOST:]


def thinned(points: Points, tolerance_m: float) -> Points:
    """The points that matter: ends, both sides of gaps, and what lies off the line between those that are kept."""
    keep = np.isnan(points[:, 0])
    bounds = [-1, *np.flatnonzero(keep).tolist(), len(points)]
    waiting = [(low + 1, high - 1) for low, high in pairwise(bounds) if high - low > 1]
    for first, last in waiting:
        keep[first] = keep[last] = True
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        inner = points[first + 1 : last, :3] - points[first, :3]
        along = points[last, :3] - points[first, :3]
        square = float(along @ along)
        share = np.clip(inner @ along / square, 0.0, 1.0) if square > 0.0 else np.zeros(len(inner))
        off = inner - share[:, None] * along
        squares = np.einsum("ij,ij->i", off, off)
        farthest = int(squares.argmax())
        if squares[farthest] > tolerance_m * tolerance_m:
            middle = first + 1 + farthest
            keep[middle] = True
            waiting += [(first, middle), (middle, last)]
    return points[keep]


def _near(one: NDArray[np.float64], other: Vector3) -> bool:
    return all(abs(float(mine) - its) < STANDING_M for mine, its in zip(one, other, strict=True))
