"""Line fits around each point of a scan: the wall's direction, and its uncertainty."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3_onboard.algorithms.scan_matching.planar import Array
from gloc3_onboard.algorithms.scan_matching.scan_points import ScanPoints

HALF_LENGTH_M: Final = 0.2
"""A piece of wall reaches so far to both sides, over at least three and at most twelve beams."""
FEWEST: Final = 3
MOST: Final = 12
SHORT: Final = 2
"""So many beams to both sides where the longer piece is not straight: jambs, posts."""
GAP_M: Final = 0.15
GAP_SHARE: Final = 0.12
"""Neighbours farther apart than this, and a share of their range, are not of one wall."""
ROUGH_M: Final = 0.025
"""A piece that is rougher is a corner, or no wall at all."""
NOISE_M: Final = 0.005
"""No scanner is taken for better than this."""


class Lines(NamedTuple):
    """One line fit per point; the arrays are as long as the points."""

    feet_m: Array
    """The point, moved onto its line; shape (n, 2)."""
    normals: Array
    """Across the line, of unit length; shape (n, 2)."""
    angle_std_rad: Array
    """How well the line's direction is known."""
    is_line: NDArray[np.bool_]
    """Whether there is a line at all."""


class _Sums(NamedTuple):
    """Running sums along a scan, from which any run of points can be fitted."""

    totals: Array
    begins: NDArray[np.intp]
    """First point of the gapless run around each point, and the one after its last."""
    ends: NDArray[np.intp]


def lines_of(scan: ScanPoints) -> Lines:
    """Fits a line to the neighbours of each point, by sums over runs of points (total least squares)."""
    points = scan.points_m
    sums = _sums_of(scan)
    half = np.clip(HALF_LENGTH_M / (np.maximum(scan.ranges_m, 0.1) * scan.step_rad), FEWEST, MOST).astype(np.intp)
    long = _fitted(points, sums, np.arange(len(points)), half)
    rest = np.flatnonzero(~long.is_line)
    short = _fitted(points, sums, rest, np.full(len(rest), SHORT))
    for whole, part in zip(long, short, strict=True):
        whole[rest] = part
    return long


def _sums_of(scan: ScanPoints) -> _Sums:
    points = scan.points_m
    gap = np.hypot(*np.diff(points, axis=0).T)
    is_break = gap > GAP_M + GAP_SHARE * np.minimum(scan.ranges_m[1:], scan.ranges_m[:-1])
    runs = np.concatenate(((0,), np.cumsum(is_break)))
    x, y = points.T
    totals = np.zeros((5, len(points) + 1))
    np.cumsum(np.stack((x, y, x * x, x * y, y * y)), axis=1, out=totals[:, 1:])
    return _Sums(totals, np.searchsorted(runs, runs, "left"), np.searchsorted(runs, runs, "right"))


def _fitted(points: Array, sums: _Sums, index: NDArray[np.intp], half: NDArray[np.intp]) -> Lines:
    """Lines fitted around some of the points, over a number of points to both sides."""
    low, high = np.maximum(index - half, sums.begins[index]), np.minimum(index + half + 1, sums.ends[index])
    number = (high - low).astype(np.float64)
    sx, sy, sxx, sxy, syy = (sums.totals[:, high] - sums.totals[:, low]) / number
    vxx, vxy, vyy = sxx - sx * sx, sxy - sx * sy, syy - sy * sy
    # Eigenvalues and axes of the 2 x 2 scatter matrix in closed form; the normal is the smaller one's axis.
    middle, spread = 0.5 * (vxx + vyy), np.hypot(0.5 * (vxx - vyy), vxy)
    along, across = middle + spread, np.maximum(middle - spread, NOISE_M**2)
    angle = 0.5 * np.arctan2(2.0 * vxy, vxx - vyy)
    normals = np.column_stack((-np.sin(angle), np.cos(angle)))
    x, y = points[index].T
    off = normals[:, 0] * (x - sx) + normals[:, 1] * (y - sy)
    # With few points the residuals say little of the noise: as much is added as the fit has taken away.
    noise = across * number / np.maximum(number - 2.0, 1.0)
    std = np.sqrt(noise / (number * np.maximum(along, 1e-9)))
    is_line = (number >= FEWEST) & (across < ROUGH_M**2) & (across < 0.1 * along) & (std < 0.35)
    return Lines(points[index] - off[:, None] * normals, normals, std, is_line)
