"""Offset in time between two sensors that feel the same turn: where their rates agree best."""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from gloc3.errors import Refused
from gloc3_onboard.algorithms.calibration.boards import Floats

GRID_S: Final = 0.005
LEAST_OVERLAP_S: Final = 3.0
BLOCKS: Final = 10
STAMP_STD_S: Final = 1e-4
"""No offset in time is known better: the stamps of sensors are not more exact."""


class RateOffset(NamedTuple):
    """Where two rates agree best."""

    offset_s: float
    """To be added to the first one's times."""
    correlation: float
    """There, from -1 to 1."""


def rate_offset(first_s: Floats, first: Floats, second_s: Floats, second: Floats, most_s: float) -> RateOffset:
    """The offset at which two rates correlate best, by their absolute correlation.

    Args:
        first_s: times of the first rate.
        first: its values.
        second_s: times of the second.
        second: its values.
        most_s: the largest offset that is tried, either way.

    Raises:
        Refused: they do not overlap for long enough.
    """
    begin_s, end_s = max(first_s[0], second_s[0] + most_s), min(first_s[-1], second_s[-1] - most_s)
    if end_s - begin_s < LEAST_OVERLAP_S:
        raise Refused(
            f"the data overlap for {max(0.0, end_s - begin_s):.1f} s, less {most_s:g} s at either end: "
            f"{LEAST_OVERLAP_S:g} s are the least"
        )
    grid_s = np.arange(begin_s, end_s, GRID_S)
    one = np.interp(grid_s, first_s, first)
    steps = round(most_s / GRID_S)
    wide_s = begin_s + GRID_S * np.arange(-steps, len(grid_s) + steps)
    other = np.interp(wide_s, second_s, second)
    one = one - one.mean()
    count = len(one)
    sums = np.concatenate(([0.0], np.cumsum(other)))
    squares = np.concatenate(([0.0], np.cumsum(other**2)))
    means = (sums[count:] - sums[:-count]) / count
    spreads = np.sqrt(np.maximum((squares[count:] - squares[:-count]) / count - means**2, 1e-18))
    values = np.correlate(other, one, "valid") / (count * spreads * max(float(one.std()), 1e-9))
    best = int(np.abs(values).argmax())
    offset = float(best)
    if 0 < best < len(values) - 1:
        a, b, c = np.abs(values[best - 1 : best + 2])
        offset += 0.5 * (a - c) / min(a - 2.0 * b + c, -1e-12)
    return RateOffset((offset - steps) * GRID_S, float(values[best]))


def jackknife_std(count: int, solve: Callable[["np.ndarray[tuple[int, ...], np.dtype[np.bool_]]"], Floats]) -> Floats:
    """Standard deviations of a solution, from how it changes without one stretch of the data after another.

    Args:
        count: of the measurements, in order of time.
        solve: the solution from those that are chosen.
    """
    blocks = np.arange(count) * BLOCKS // count
    others = np.array([solve(blocks != block) for block in range(BLOCKS)])
    return np.asarray(np.sqrt((BLOCKS - 1) / BLOCKS * ((others - others.mean(axis=0)) ** 2).sum(axis=0)))
