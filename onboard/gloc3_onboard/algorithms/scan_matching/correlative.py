"""Correlative scan matching over a window of positions and headings.

Each candidate is scored by how many points fall where the map has walls (Olson, "Real-time correlative scan matching",
ICRA 2009).
"""

from math import ceil
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.camera.opencv import load_opencv
from gloc3_onboard.algorithms.scan_matching.planar import Array, Planar

POINTS: Final = 90
"""So many points of the scan vote."""
HEADING_RAD: Final = 0.045
"""Step of the headings."""
PRIOR: Final = 0.15
"""What a place at the edge of the window must gather more than one in its middle, as a share of all votes."""
FARTHEST_M: Final = 15.0
BEST: Final = 6
"""So many candidates are handed back…"""
LEAST: Final = 0.7
"""…and none that gathers less than this share of the best one's votes."""


class SearchWindow(NamedTuple):
    """Search window around a guess."""

    distance_m: float
    heading_rad: float


def candidates(points: Array, feet: Array, guess: Planar, window: SearchWindow, prior: float = PRIOR) -> list[Planar]:
    """Likely poses of a scan in a map, the best first.

    Args:
        points: of the scan; shape (n, 2).
        feet: of the map; shape (m, 2).
        guess: where the scan was taken, about.
        window: how wrong the guess may be.
        prior: what a place at the edge of the window must gather more than one in its middle.
    """
    cell_m = min(max(window.distance_m / 4.0, 0.08), 0.2)
    voters = _spread(points, cell_m)
    reach = ceil(window.distance_m / cell_m)
    # Look-up table: the map rasterized and blurred (Olson 2009).
    raster, corner = _raster(feet, guess, cell_m, reach)
    turns = ceil(window.heading_rad / HEADING_RAD)
    headings = np.asarray(guess.yaw_rad + HEADING_RAD * np.arange(-turns, turns + 1), np.float64)
    c, s = np.cos(headings)[:, None], np.sin(headings)[:, None]
    # Rotate the points once for each heading; translations are then shifts by whole cells.
    rows = (c * voters[:, 0] - s * voters[:, 1] + (guess.x_m - corner[0])) / cell_m
    columns = (s * voters[:, 0] + c * voters[:, 1] + (guess.y_m - corner[1])) / cell_m
    height, width = raster.shape
    row = np.clip(rows.astype(np.intp), reach, height - 1 - reach)
    column = np.clip(columns.astype(np.intp), reach, width - 1 - reach)
    shifts = np.arange(-reach, reach + 1)
    offsets = (shifts[:, None] * width + shifts).ravel()
    base = row * width + column
    # Score: for each heading and shift, the sum of the table's values at the points.
    scores = np.empty((len(headings), len(offsets)), np.int64)
    flat = raster.ravel()
    for number, row_base in enumerate(base):
        scores[number] = flat[row_base[:, None] + offsets].sum(axis=0, dtype=np.int64)
    places_m = np.asarray(cell_m * shifts, np.float64)
    # The farther from the guess, the better a place must be.
    away = (places_m / window.distance_m) ** 2
    turned = ((headings - guess.yaw_rad) / window.heading_rad) ** 2
    cost = turned[:, None] + (away[:, None] + away).ravel()
    scores -= (prior * 255.0 * len(voters) * cost).astype(np.int64)
    return _peaks(scores.reshape(len(headings), len(shifts), len(shifts)), headings, places_m, guess)


def _spread(points: Array, cell_m: float) -> Array:
    """Some of the points, evenly along the walls instead of evenly by beam."""
    near: Array = points[np.hypot(*points.T) < FARTHEST_M]
    if len(near) <= POINTS:
        return near
    steps = np.minimum(np.hypot(*np.diff(near, axis=0).T), 2.0 * cell_m)
    distances_m = np.concatenate(((0.0,), np.cumsum(steps + 0.01)))
    chosen: Array = near[
        np.unique(np.searchsorted(distances_m, np.linspace(0.0, distances_m[-1], POINTS)).clip(0, len(near) - 1))
    ]
    return chosen


def _raster(feet: Array, guess: Planar, cell_m: float, reach: int) -> tuple[NDArray[np.uint8], Array]:
    """The map as a picture: bright at its walls, less so beside them; and the place of its first cell."""
    cv2 = load_opencv()
    center = np.array((guess.x_m, guess.y_m))
    near = feet[np.max(np.abs(feet - center), axis=1) < FARTHEST_M + 2.0]
    if not len(near):
        near = center[None]
    border_m = (reach + 3) * cell_m
    corner = np.min(near, axis=0) - border_m
    size = np.ceil((np.max(near, axis=0) + border_m - corner) / cell_m).astype(np.intp) + 1
    picture = np.zeros((int(size[0]), int(size[1])), np.uint8)
    cells = ((near - corner) / cell_m).astype(np.intp)
    picture[cells[:, 0], cells[:, 1]] = 255
    wide = cv2.dilate(picture, np.ones((3, 3), np.uint8))
    soft: NDArray[np.uint8] = np.maximum(picture, cv2.GaussianBlur(wide, (5, 5), 1.0))
    return soft, corner


def _peaks(scores: NDArray[np.int64], headings: Array, shifts: Array, guess: Planar) -> list[Planar]:
    """The highest scores that lie apart from each other."""
    found: list[Planar] = []
    left, least = scores.copy(), max(LEAST * float(scores.max()), 0.0)
    for _ in range(BEST):
        turn, row, column = (int(i) for i in np.unravel_index(int(np.argmax(left)), left.shape))
        if left[turn, row, column] <= least:
            break
        found.append(Planar(guess.x_m + float(shifts[row]), guess.y_m + float(shifts[column]), float(headings[turn])))
        left[max(turn - 2, 0) : turn + 3, max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3] = 0
    return found
