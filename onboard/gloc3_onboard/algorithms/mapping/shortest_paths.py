"""Shortest ways in a known space: Dijkstra's search over its cells, then straight legs."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gloc3.errors import Refused
from gloc3_onboard.algorithms.mapping.known_space import Cell, KnownSpace, Mask
from gloc3_onboard.algorithms.scan_matching.planar import Array

Place = tuple[float, float]
"""North and east, in metres."""
UNKNOWN_COSTS: Final = 0.5
"""A way through what is unknown counts as longer by this share."""
NARROW_COSTS: Final = 1.0
"""The same for a way that keeps no more than the least distance; it falls to none at `ROOM_M` more."""
ROOM_M: Final = 0.6
ESCAPE_M: Final = 2.5
"""From nearer than the distance to keep, a vehicle may go away by so much without coming nearer to anything."""
ESCAPE_COSTS: Final = 20.0
_STEPS: Final = ((0, 1), (1, 0), (1, 1), (1, -1))


class ShortestPaths:
    """The shortest ways from one place to all others.

    Args:
        space: what is known.
        start: north and east of the place, in metres.
        is_through_unknown: whether ways lead through what is unknown, too.
    """

    def __init__(self, space: KnownSpace, start: Sequence[float], *, is_through_unknown: bool = True) -> None:
        from scipy.sparse.csgraph import dijkstra

        self._space = space
        self._start: Place = (float(start[0]), float(start[1]))
        self.may_enter: Final[Mask] = _may_enter(space, self._start, is_through_unknown=is_through_unknown)
        """Cells that a way may lead through."""
        first = int(np.ravel_multi_index(space.cell(start), space.shape))
        found, before = dijkstra(_graph(space, self.may_enter), indices=first, return_predecessors=True)
        self.costs: Final[Array] = found.reshape(space.shape)
        """Of the way to each cell, in metres, more where it is narrow or unknown; infinite where there is none."""
        self._before: NDArray[np.int32] = before

    def to(self, goal: Cell) -> list[Place]:
        """The corners of the way to a cell, without the start.

        Raises:
            Refused: there is none.
        """
        if not np.isfinite(self.costs[goal]):
            raise Refused("no way leads there")
        index, cells = int(np.ravel_multi_index(goal, self._space.shape)), []
        while index >= 0:
            cells.append(divmod(index, self._space.shape[1]))
            index = int(self._before[index])
        return self._straightened([self._start, *map(self._space.place, _corners(cells[-2::-1]))])

    def is_clear(self, start: Sequence[float], end: Sequence[float]) -> bool:
        """Whether a straight leg leads through cells that may be entered."""
        return bool(self.may_enter[self._space.line(start, end)].all())

    def _straightened(self, places: list[Place]) -> list[Place]:
        """The corners of a way with straight legs as long as they are clear."""
        found, at = [], 0
        while at < len(places) - 1:
            ahead = next(
                (one for one in range(len(places) - 1, at + 1, -1) if self.is_clear(places[at], places[one])), at + 1
            )
            found.append(places[ahead])
            at = ahead
        return found


def _corners(cells: list[Cell]) -> list[Cell]:
    """The cells at which a way turns, and its last."""
    steps = [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(cells)]
    turns = [cells[index + 1] for index, (before, after) in enumerate(pairwise(steps)) if before != after]
    return [*cells[:1], *turns, *cells[1:][-1:]]


def _may_enter(space: KnownSpace, start: Place, *, is_through_unknown: bool) -> Mask:
    """Where the vehicle may be; near the start also what leads away from where it should not be."""
    north, east = space.centers()
    is_near = np.hypot(north - start[0], east - start[1]) < ESCAPE_M
    here = space.cell(start)
    escape = is_near & ~space.occupied & (space.clearance_m >= space.clearance_m[here])
    if space.allowed[here]:
        escape &= space.allowed
    mask: Mask = (space.passable if is_through_unknown else space.passable & space.free) | escape
    mask[here] = True
    return mask


def _graph(space: KnownSpace, mask: Mask) -> Any:
    """The cells of a mask joined with their neighbours, as a sparse matrix of costs."""
    from scipy.sparse import csr_matrix

    weight = 1.0 + UNKNOWN_COSTS * ~space.free + ESCAPE_COSTS * ~space.passable
    weight += NARROW_COSTS * np.clip(1.0 - (space.clearance_m - space.keep_m) / ROOM_M, 0.0, 1.0)
    index = np.arange(mask.size).reshape(mask.shape)
    ones, others, costs = [], [], []
    for down, right in _STEPS:
        a = (slice(0, mask.shape[0] - down), slice(max(0, -right), mask.shape[1] - max(0, right)))
        b = (slice(down, mask.shape[0]), slice(max(0, right), mask.shape[1] - max(0, -right)))
        both = mask[a] & mask[b]
        ones.append(index[a][both])
        others.append(index[b][both])
        costs.append((0.5 * math.hypot(down, right) * space.cell_m) * (weight[a] + weight[b])[both])
    one, other, cost = (np.concatenate(part) for part in (ones, others, costs))
    between = (np.concatenate((one, other)), np.concatenate((other, one)))
    return csr_matrix((np.tile(cost, 2), between), shape=(mask.size, mask.size))
