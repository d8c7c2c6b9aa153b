"""Where a vehicle may be, as far as a map and the fence say: the level grid that ways are searched in."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.errors import Refused
from gloc3.messages.frames import Vector3
from gloc3.messages.perception import CELL_FREE, CELL_OCCUPIED, OccupancyMap
from gloc3.mission.model.fence import Area, Fence
from gloc3_onboard.algorithms.scan_matching.planar import Array

Cells = NDArray[np.uint8]
"""States of cells."""
Mask = NDArray[np.bool_]
"""Of the grid, shape (rows, columns)."""
Cell = tuple[int, int]
"""Row and column."""
MOST_CELLS: Final = 250_000
"""Cells of the grid at most; a larger area gets larger cells."""
AROUND_M: Final = 4.0
"""The grid reaches so far beyond the map, the vehicle and its goal."""
VERTICAL_M: Final = 0.35
"""What is so far above or below the vehicle is in its way."""


class SpaceLimits(NamedTuple):
    """What is kept from what."""

    keep_m: float
    """From what is occupied, to the vehicle's middle."""
    fence: Fence | None = None
    fence_margin_m: float = 0.0


def cells_of(message: OccupancyMap) -> Cells:
    """The states of a map's cells, shape (layers, rows, columns).

    Raises:
        Refused: their number is not that of the map.
    """
    try:
        layers = message.layers()
    except ValueError as error:
        raise Refused(str(error)) from error
    return np.frombuffer(b"".join(layers), np.uint8).reshape(len(layers), message.rows, message.columns)


class KnownSpace:
    """Occupied, free and unknown cells between two heights, and the clearance of each.

    Args:
        known: the map.
        step: its cells are joined by so many on each side.
        heights_m: lowest and highest height above the frame's origin that the vehicle will have.
        limits: what is kept from what.
        places_ne_m: places that the grid must hold, such as the goal.
    """

    def __init__(
        self,
        known: OccupancyMap,
        step: int,
        heights_m: tuple[float, float],
        limits: SpaceLimits,
        places_ne_m: Sequence[tuple[float, float]],
    ) -> None:
        from scipy.ndimage import distance_transform_edt

        corners = [known.corner_ne_m] if known.rows * known.columns else []
        corners += [(n + known.cell_m * known.rows, e + known.cell_m * known.columns) for n, e in corners]
        around = np.array([*corners, *places_ne_m], np.float64)
        low, high = around.min(axis=0) - AROUND_M, around.max(axis=0) + AROUND_M
        while np.prod((high - low) / (step * known.cell_m)) > MOST_CELLS:
            step += 1
        self.cell_m: Final = step * known.cell_m
        self.keep_m: Final = limits.keep_m
        self._first = np.floor(low / self.cell_m).astype(np.intp)
        rows, columns = (np.ceil(high / self.cell_m).astype(np.intp) - self._first).tolist()
        self.shape: Final[Cell] = (rows, columns)
        self.occupied, free = self._states(known, step, heights_m)
        self.free: Final[Mask] = free & ~self.occupied
        """Known, and nothing there."""
        self.inside: Final = self._inside(limits.fence)
        """Inside the fence."""
        none = np.full(self.shape, np.inf)
        # From the middle of a cell to the nearest corner of an occupied one, at least.
        away = distance_transform_edt(~self.occupied) * self.cell_m if self.occupied.any() else none
        self.clearance_m: Final[Array] = away - math.sqrt(0.5) * self.cell_m
        """Of the middle of each cell, from what is occupied."""
        to_fence = none if self.inside.all() else distance_transform_edt(self.inside) * self.cell_m
        is_allowed = to_fence >= limits.fence_margin_m + self.cell_m
        self.passable: Final[Mask] = (self.clearance_m >= limits.keep_m) & is_allowed
        """Where the vehicle's middle may be, known or not."""
        self.allowed: Final[Mask] = is_allowed
        """Where it may be by the fence alone."""

    def cell(self, place: Sequence[float]) -> Cell:
        """The cell of a place (north, east, …), the nearest one for a place beside the grid."""
        row, column = (math.floor(place[axis] / self.cell_m) - int(self._first[axis]) for axis in (0, 1))
        return min(max(row, 0), self.shape[0] - 1), min(max(column, 0), self.shape[1] - 1)

    def place(self, cell: Sequence[int]) -> tuple[float, float]:
        """North and east of the middle of a cell."""
        north, east = ((cell[axis] + int(self._first[axis]) + 0.5) * self.cell_m for axis in (0, 1))
        return north, east

    def centers(self) -> tuple[Array, Array]:
        """North of each row, of shape (rows, 1), and east of each column, (1, columns)."""
        north = (np.arange(self.shape[0]) + self._first[0] + 0.5) * self.cell_m
        east = (np.arange(self.shape[1]) + self._first[1] + 0.5) * self.cell_m
        return north[:, None], east[None, :]

    def line(self, start: Sequence[float], end: Sequence[float]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of the cells along a straight leg, half a cell apart."""
        count = max(2, math.ceil(2.0 * math.dist(start[:2], end[:2]) / self.cell_m) + 1)
        share = np.linspace(0.0, 1.0, count)
        found = []
        for axis in (0, 1):
            place = start[axis] + share * (end[axis] - start[axis])
            index = np.floor(place / self.cell_m).astype(np.intp) - self._first[axis]
            found.append(np.clip(index, 0, self.shape[axis] - 1))
        return found[0], found[1]

    def within(self, area: Area) -> Mask:
        """The cells whose middle is in an area."""
        north, east = self.centers()
        if not area.polygon_ne_m:
            return np.hypot(north - area.center_ne_m[0], east - area.center_ne_m[1]) <= area.radius_m
        inside = np.zeros(self.shape, bool)
        for (n0, e0), (n1, e1) in area.edges():
            if e0 != e1:
                inside ^= ((e0 > east) != (e1 > east)) & (north < n0 + (n1 - n0) * (east - e0) / (e1 - e0))
        return inside

    def _states(self, known: OccupancyMap, step: int, heights_m: tuple[float, float]) -> tuple[Mask, Mask]:
        lowest, highest = (heights_m[0] - VERTICAL_M, heights_m[1] + VERTICAL_M)
        is_near = [(level + 1) * known.layer_m > lowest and level * known.layer_m < highest for level in known.levels]
        cells = cells_of(known)[is_near]
        occupied, seen = np.zeros(self.shape, bool), np.zeros(self.shape, bool)
        if not len(cells) or not cells.size:
            return occupied, seen
        first = np.round(np.array(known.corner_ne_m) / known.cell_m).astype(np.intp) - self._first * step
        for state, into in ((CELL_OCCUPIED, occupied), (CELL_FREE, seen)):
            rows, columns = np.nonzero((cells == state).any(axis=0))
            into[(rows + first[0]) // step, (columns + first[1]) // step] = True
        return occupied, seen

    def _inside(self, fence: Fence | None) -> Mask:
        inside = np.ones(self.shape, bool)
        if fence is not None and fence.area is not None:
            inside &= self.within(fence.area)
        for area in fence.keep_out if fence is not None else ():
            inside &= ~self.within(area)
        return inside


def heights_of(start: Vector3, down_m: float) -> tuple[float, float]:
    """Lowest and highest height of a way from a position to a height, given as NED."""
    return min(-start[2], -down_m), max(-start[2], -down_m)
