"""A map of what is free and what is occupied, built from scans: a stack of level grids of counted evidence."""

import math
import zlib
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import Vector3
from gloc3.messages.perception import CELL_FREE, CELL_OCCUPIED, CELL_UNKNOWN, OccupancyMap
from gloc3_onboard.algorithms.mapping.known_space import Cells, cells_of
from gloc3_onboard.algorithms.scan_matching.planar import Array

Indices = NDArray[np.intp]
Evidence = NDArray[np.int8]
"""Of one layer, shape (rows, columns): more than 0 speaks for occupied, less for free."""
HIT: Final = 4
"""A hit counts as much as so many rays through a cell."""
OCCUPIED_FROM: Final = 6
"""Evidence of an occupied cell: two hits."""
FREE_FROM: Final = -2
"""Evidence of a free cell: two rays."""
MOST: Final = 24
LEAST: Final = -12
"""Bounds of the evidence, so that what appears or goes away is learned within seconds."""
BLOCK: Final = 32
"""The map grows by so many cells."""
BODY_M: Final = 0.3
"""Where the vehicle is, nothing else is."""
BEFORE_CELLS: Final = 0.75
"""A ray counts as free up to so many cells before its hit."""


class OccupancyStack:
    """Layers of evidence in the NED frame of the pose; grows as far as its bounds.

    Args:
        cell_m: side of a cell.
        layer_m: thickness of a layer.
        most_m: largest side of the map; what is beyond is dropped.
        most_layers: number of layers at most; others are dropped.
    """

    def __init__(self, cell_m: float, layer_m: float, most_m: float = 80.0, most_layers: int = 16) -> None:
        self.cell_m: Final = cell_m
        self.layer_m: Final = layer_m
        self._most = max(BLOCK, int(most_m / cell_m) // BLOCK * BLOCK)
        self._most_layers = most_layers
        self._rows = self._columns = (0, 0)
        """First row and the one after the last, in cells from the frame's origin; and the same of columns."""
        self._layers: dict[int, Evidence] = {}

    def add_scan(
        self,
        at_ned_m: Vector3,
        hits_ned_m: Array,
        beams: int,
        range_m: float,
        others_ne_m: Sequence[tuple[float, float]] = (),
        others_within_m: float = 1.0,
    ) -> None:
        """Adds what one scan saw. Rays without a hit say nothing: glass, black paint and the sky look alike.

        Args:
            at_ned_m: position of the scanner.
            hits_ned_m: the hits, shape (n, 3), in NED.
            beams: number of beams of a whole turn.
            range_m: hits that are farther away are not entered; the way to them counts as free as far as that.
            others_ne_m: positions of other vehicles, which are not entered.
            others_within_m: distance to them within which a hit is one of theirs.
        """
        hits = hits_ned_m[np.hypot(*(hits_ned_m[:, :2] - at_ned_m[:2]).T) > self.cell_m]
        reach, here = math.ceil(range_m / self.cell_m) + 1, [math.floor(part / self.cell_m) for part in at_ned_m[:2]]
        rows, columns = self._window(here[0], here[1], reach)
        if not len(hits) or not len(rows) or not len(columns):
            return
        free = self._free_levels(at_ned_m, hits, beams, range_m, rows, columns)
        is_entered = np.hypot(*(hits[:, :2] - at_ned_m[:2]).T) <= range_m
        for other in others_ne_m:
            is_entered &= np.hypot(*(hits[:, :2] - other).T) > others_within_m
        places = np.floor(hits[is_entered, :2] / self.cell_m).astype(np.intp) - (rows[0], columns[0])
        levels = np.floor(-hits[is_entered, 2] / self.layer_m).astype(np.intp)
        is_inside = ((places >= 0) & (places < (len(rows), len(columns)))).all(axis=1)
        places, levels = places[is_inside], levels[is_inside]
        seen = {int(level) for level in np.unique(levels)} | {int(level) for level in np.unique(free) if level != _NONE}
        for level in sorted(seen):
            layer = self._layer(level)
            if layer is None:
                continue
            part = layer[rows[0] - self._rows[0] :, columns[0] - self._columns[0] :][: len(rows), : len(columns)]
            is_hit = np.zeros(part.shape, bool)
            is_hit[tuple(places[levels == level].T)] = True
            is_free = (free == level) & ~is_hit
            part[is_free] = np.maximum(part[is_free] - 1, LEAST)
            part[is_hit] = np.minimum(part[is_hit] + HIT, MOST)

    def add_map(self, known: OccupancyMap) -> bool:
        """Adds a map that is known already, cell by cell; a few rays change it.

        Args:
            known: with the same cells and layers.

        Returns:
            Whether there is room for all of it.
        """
        first = [round(part / self.cell_m) for part in known.corner_ne_m]
        spans = (first[0], first[0] + known.rows), (first[1], first[1] + known.columns)
        self._cover(*spans)
        for (begin, end), (least, most) in zip(spans, (self._rows, self._columns), strict=True):
            if begin < least or end > most:
                return False
        for level, cells in zip(known.levels, cells_of(known), strict=True):
            layer = self._layer(level)
            if layer is not None:
                part = layer[first[0] - self._rows[0] :, first[1] - self._columns[0] :][: known.rows, : known.columns]
                part[cells == CELL_FREE] = LEAST // 2
                part[cells == CELL_OCCUPIED] = MOST // 2
        return self._layers.keys() >= set(known.levels)

    def reach(self, at_ne_m: tuple[float, float], range_m: float) -> bool:
        """Grows around a place as far as it may; whether the place is in the map then."""
        row, column = (math.floor(part / self.cell_m) for part in at_ne_m)
        rows, columns = self._window(row, column, math.ceil(range_m / self.cell_m) + 1)
        return row in rows and column in columns

    def message(self, height_m: float) -> OccupancyMap:
        """What is known, as a message.

        Args:
            height_m: height of the vehicle above the frame's origin.
        """
        levels = sorted(level for level, layer in self._layers.items() if layer.any())
        states = (
            np.stack([_states(self._layers[level]) for level in levels]) if levels else np.zeros((0, 1, 1), np.uint8)
        )
        rows, columns = (np.flatnonzero(states.any(axis=axes)) for axes in ((0, 2), (0, 1)))
        if len(rows):
            states = states[:, rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        first = (int(rows[0]), int(columns[0])) if len(rows) else (0, 0)
        return OccupancyMap(
            corner_ne_m=((self._rows[0] + first[0]) * self.cell_m, (self._columns[0] + first[1]) * self.cell_m),
            cell_m=self.cell_m,
            rows=states.shape[1],
            columns=states.shape[2],
            layer_m=self.layer_m,
            levels=levels,
            cells=zlib.compress(states.tobytes(), 1),
            level=math.floor(height_m / self.layer_m),
        )

    def _free_levels(
        self, at_ned_m: Vector3, hits: Array, beams: int, range_m: float, rows: Indices, columns: Indices
    ) -> Indices:
        """Level at which a ray passes through each cell of a window; `_NONE` where none does."""
        north, east, down = at_ned_m
        offset = hits[:, :2] - (north, east)
        distance = np.hypot(*offset.T)
        ranges, slopes = np.full(beams, np.inf), np.zeros(beams)
        order = np.argsort(-distance, kind="stable")  # of several in one direction, the nearest is written last
        bins = _bins(offset[order], beams)
        ranges[bins], slopes[bins] = distance[order], (hits[order, 2] - down) / distance[order]
        ranges[np.isinf(ranges)] = 0.0
        ahead = (rows[:, None] + 0.5) * self.cell_m - north
        aside = (columns[None, :] + 0.5) * self.cell_m - east
        away = np.hypot(ahead, aside)
        bins = np.floor(np.arctan2(aside, ahead) * (beams / (2.0 * math.pi)) + 0.5).astype(np.intp) % beams
        is_free = (away < np.minimum(ranges[bins] - BEFORE_CELLS * self.cell_m, range_m)) | (away < BODY_M)
        levels = np.floor(-(down + slopes[bins] * away) / self.layer_m).astype(np.intp)
        return np.where(is_free, levels, _NONE)

    def _window(self, row: int, column: int, reach: int) -> tuple[Indices, Indices]:
        """Rows and columns around a cell, as far as the map may grow there."""
        self._cover((row - reach, row + reach + 1), (column - reach, column + reach + 1))
        return (
            np.arange(max(row - reach, self._rows[0]), min(row + reach + 1, self._rows[1])),
            np.arange(max(column - reach, self._columns[0]), min(column + reach + 1, self._columns[1])),
        )

    def _cover(self, row: tuple[int, int], column: tuple[int, int]) -> None:
        """Grows to hold the cells from one row and column to others, as far as it may."""
        (top, left), size = (self._rows[0], self._columns[0]), self._shape
        self._rows = _grown(self._rows, *row, self._most)
        self._columns = _grown(self._columns, *column, self._most)
        if size == self._shape:
            return
        for level, layer in self._layers.items():
            grown = np.zeros(self._shape, np.int8)
            grown[top - self._rows[0] :, left - self._columns[0] :][: size[0], : size[1]] = layer
            self._layers[level] = grown

    @property
    def _shape(self) -> tuple[int, int]:
        return self._rows[1] - self._rows[0], self._columns[1] - self._columns[0]

    def _layer(self, level: int) -> Evidence | None:
        """A layer, a new one where there is none and room for it."""
        if level not in self._layers:
            if len(self._layers) >= self._most_layers:
                return None
            self._layers[level] = np.zeros(self._shape, np.int8)
        return self._layers[level]


_NONE: Final = np.iinfo(np.intp).min


def _states(layer: Evidence) -> Cells:
    is_free, is_occupied = layer <= FREE_FROM, layer >= OCCUPIED_FROM
    return np.select([is_free, is_occupied], [CELL_FREE, CELL_OCCUPIED], CELL_UNKNOWN).astype(np.uint8)


def _bins(offset: Array, beams: int) -> Indices:
    return np.floor(np.arctan2(offset[:, 1], offset[:, 0]) * (beams / (2.0 * math.pi)) + 0.5).astype(np.intp) % beams


def _grown(span: tuple[int, int], first: int, end: int, most: int) -> tuple[int, int]:
    """A span of cells that grows in blocks to hold another one, as far as it may."""
    first, end = first // BLOCK * BLOCK, -(-end // BLOCK) * BLOCK
    if span[0] == span[1]:
        first += max(0, end - first - most) // 2 // BLOCK * BLOCK
        return first, min(end, first + most)
    first = max(min(span[0], first), span[1] - most)
    return first, min(max(span[1], end), first + most)
