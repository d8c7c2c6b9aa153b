"""Progress of a vehicle along the requested path, point by point as it flies."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import Vector3

SLACK_M: Final = 2.0
"""Distance by which the position on the path may advance beyond the vehicle's motion, from point to point."""
KEPT: Final = 4096

Floats = NDArray[np.float64]


class PathProgress:
    """Tracks a vehicle's position on a path, never backwards, and never far ahead of the distance flown."""

    def __init__(self, path: Sequence[Vector3]) -> None:
        """Progress along a path.

        Args:
            path: its corners; two at least.
        """
        corners = np.asarray(path, np.float64).reshape(-1, 3)
        self._begins: Final = corners[:-1]
        self._steps: Final = np.diff(corners, axis=0)
        self._lengths: Final = np.sqrt((self._steps**2).sum(axis=1))
        self._starts: Final = np.cumsum(self._lengths) - self._lengths
        self.length_m: Final = float(self._lengths.sum())
        self.reached_m = 0.0
        """How far the vehicle has come."""
        self._last: Floats | None = None
        self._flown: list[tuple[float, float]] = []
        self.until_s = float("-inf")
        """The time of the last point."""

    @property
    def flown(self) -> Floats:
        """Rows of how far along the path, and the height there."""
        return np.array(self._flown or np.empty((0, 2)))

    def advance(self, points: Floats, at_least_m: float = 0.0) -> None:
        """Adds further points.

        Args:
            points: rows of three coordinates as of the path (the third pointing down), and the time.
            at_least_m: position on the path at which the current action begins.
        """
        self.reached_m = max(self.reached_m, min(at_least_m, self.length_m))
        for row in points:
            if row[3] <= self.until_s or np.isnan(row[0]):
                continue
            self.until_s = float(row[3])
            self._advance_to(row[:3])
            if len(self._flown) > KEPT:
                self._flown = self._flown[::2]

    def _advance_to(self, point: Floats) -> None:
        moved_m = 0.0 if self._last is None else float(np.sqrt(((point - self._last) ** 2).sum()))
        self._last = point.copy()
        limit_m = self.reached_m + 2.0 * moved_m + SLACK_M
        low = np.maximum(self.reached_m - self._starts, 0.0)
        high = np.minimum(limit_m - self._starts, self._lengths)
        near = np.flatnonzero((low <= high) & (self._lengths > 0.0))
        if len(near):
            along = ((point - self._begins[near]) * self._steps[near]).sum(axis=1) / self._lengths[near]
            along = np.clip(along, low[near], high[near])
            places = self._begins[near] + self._steps[near] * (along / self._lengths[near])[:, None]
            squares = ((places - point) ** 2).sum(axis=1)
            best = int((squares + 1e-6 * np.arange(len(near))).argmin())
            self.reached_m = float(self._starts[near[best]] + along[best])
        self._flown.append((self.reached_m, -float(point[2])))
