"""Frontiers: where what is known and free borders on what is unknown, and from where to look at it."""

import math
from typing import Final, NamedTuple

import numpy as np

from gloc3_onboard.algorithms.mapping.known_space import Cell, KnownSpace, Mask
from gloc3_onboard.algorithms.mapping.shortest_paths import Place, ShortestPaths

LEAST_CELLS: Final = 3
"""Frontiers of fewer cells are gaps between rays."""
SAME_M: Final = 0.8
"""A frontier no farther from one that was given up is that one."""
LOOKS: Final = 60
"""So many places are tried from which a frontier may be seen, the nearest first."""


class Viewpoint(NamedTuple):
    """A place to fly to, and what is to be seen from there."""

    corners_ne_m: list[Place]
    """Of the way to it."""
    frontier_ne_m: Place
    cost_m: float
    """Of the way."""


class Frontiers:
    """The frontiers of a space inside an area, in groups of cells that touch.

    Args:
        space: what is known.
        area: cells that are to be explored.
    """

    def __init__(self, space: KnownSpace, area: Mask) -> None:
        from scipy.ndimage import binary_dilation, label

        self._space = space
        unknown = area & ~space.free & ~space.occupied
        self.is_frontier: Final[Mask] = area & space.free & binary_dilation(unknown)
        labels, count = label(self.is_frontier, structure=np.ones((3, 3)))
        groups = [np.argwhere(labels == number) for number in range(1, count + 1)]
        self.places: Final[list[Place]] = [self._middle(group) for group in groups if len(group) >= LEAST_CELLS]
        """One place of each."""

    def is_there(self, place: Place) -> bool:
        """Whether there is still a frontier at a place."""
        return any(math.dist(place, one) <= SAME_M for one in self.places) or self._is_near(place)

    def nearest_view(self, paths: ShortestPaths, view_m: float, given_up: list[Place]) -> Viewpoint | None:
        """The place that is reached soonest and from which a frontier can be seen.

        Args:
            paths: from the vehicle.
            view_m: longest distance to look from.
            given_up: frontiers that are left alone.
        """
        best: tuple[float, Cell, Place] | None = None
        for frontier in self.places:
            if any(math.dist(frontier, one) <= SAME_M for one in given_up):
                continue
            found = self._view_of(frontier, paths, view_m, math.inf if best is None else best[0])
            if found is not None:
                best = (*found, frontier)
        if best is None:
            return None
        cost_m, cell, frontier = best
        return Viewpoint(paths.to(cell), frontier, cost_m)

    def _view_of(
        self, frontier: Place, paths: ShortestPaths, view_m: float, below_m: float
    ) -> tuple[float, Cell] | None:
        """The nearest place with a view of a frontier, where the way to it costs less than the best so far."""
        space = self._space
        north, east = space.centers()
        is_candidate = np.hypot(north - frontier[0], east - frontier[1]) <= view_m
        is_candidate &= space.passable & (paths.costs < below_m)
        cells = np.argwhere(is_candidate)
        costs = paths.costs[is_candidate]
        order = np.argsort(costs, kind="stable")
        for index in order[:: max(1, len(order) // LOOKS)]:
            cell = (int(cells[index][0]), int(cells[index][1]))
            if not space.occupied[space.line(space.place(cell), frontier)].any():
                return float(costs[index]), cell
        return None

    def _is_near(self, place: Place) -> bool:
        row, column = self._space.cell(place)
        reach = max(1, round(0.5 * SAME_M / self._space.cell_m))
        around = self.is_frontier[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1]
        return int(np.count_nonzero(around)) >= LEAST_CELLS

    def _middle(self, group: "np.ndarray[tuple[int, int], np.dtype[np.intp]]") -> Place:
        """The cell of a group that is nearest to its middle."""
        nearest = group[np.argmin(((group - group.mean(axis=0)) ** 2).sum(axis=1))]
        return self._space.place((int(nearest[0]), int(nearest[1])))
