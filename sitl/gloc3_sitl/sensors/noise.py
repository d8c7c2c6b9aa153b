"""Seeded noise: standard normal numbers drawn in blocks, and slowly wandering errors."""

from collections.abc import Callable, Iterator
from itertools import chain
from math import exp, sqrt
from zlib import crc32

import numpy as np

Draw = Callable[[], float]
"""Gives the next standard normal number."""

_BLOCK = 512


def normals(seed: int, stream: str) -> Draw:
    """A stream of standard normal numbers, one for each sensor, so that no sensor's rate or fault changes another's noise.

    One number costs about 50 ns.
    """
    generator = np.random.Generator(np.random.PCG64([seed, crc32(stream.encode())]))

    def blocks() -> Iterator[list[float]]:
        while True:
            yield generator.standard_normal(_BLOCK).tolist()

    return chain.from_iterable(blocks()).__next__


class Wander:
    """A first-order Gauss-Markov error with a standard deviation and a correlation time."""

    def __init__(self, draw: Draw, deviation: float, time_constant_s: float, period_s: float) -> None:
        self._draw = draw
        self._keep = exp(-period_s / time_constant_s)
        self._push = deviation * sqrt(1.0 - self._keep**2)
        self.value = deviation * draw()
        """The error now, in the unit of the deviation."""

    def step(self) -> float:
        """Advances by one period."""
        self.value = self._keep * self.value + self._push * self._draw()
        return self.value
