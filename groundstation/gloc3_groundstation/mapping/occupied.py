"""The occupied cells of a vehicle's own map, as points to draw."""

from functools import lru_cache

import numpy as np

from gloc3.messages.perception import CELL_OCCUPIED, OccupancyMap
from gloc3_groundstation.mapping.ground import Plane


def occupied_of(known: OccupancyMap) -> Plane:
    """Rows of north and east: the middles of the cells that are occupied at the vehicle's height; none of a damaged map."""
    try:
        cells = known.layer_of_vehicle()
    except ValueError:
        return np.zeros((0, 2))
    return _middles(cells, known.columns, known.corner_ne_m, known.cell_m)


@lru_cache(maxsize=8)
def _middles(cells: bytes, columns: int, corner_ne_m: tuple[float, float], cell_m: float) -> Plane:
    index = np.flatnonzero(np.frombuffer(cells, np.uint8) == CELL_OCCUPIED)
    middles: Plane = (np.column_stack(np.divmod(index, max(1, columns))) + 0.5) * cell_m + corner_ne_m
    return middles
