"""Conversion between metres on the map's plane and dots on the screen; scales in round steps."""

from collections.abc import Iterable
from math import cos, floor, log10, radians, sin
from typing import Final, NamedTuple

import numpy as np

from gloc3_groundstation.mapping.ground import Plane

FINEST_M: Final = 0.002
COARSEST_M: Final = 2_000.0
ZOOM: Final = 2.0**0.5
"""A step of the zoom keys."""


class Projection(NamedTuple):
    """A section of the plane on the screen."""

    north_m: float
    """Of the middle of the screen."""
    east_m: float
    m_per_dot: float
    up_deg: float
    """The bearing that points up."""
    width: int
    """Dots across."""
    height: int
    """Dots down."""

    def dots(self, plane_m: Plane) -> Plane:
        """Rows of north and east as rows of x (right) and y (down) in dots."""
        turn = radians(self.up_deg)
        north, east = plane_m[:, 0] - self.north_m, plane_m[:, 1] - self.east_m
        right, up = east * cos(turn) - north * sin(turn), north * cos(turn) + east * sin(turn)
        return np.column_stack((self.width / 2.0 + right / self.m_per_dot, self.height / 2.0 - up / self.m_per_dot))

    def dot(self, north_m: float, east_m: float) -> tuple[float, float]:
        """X and y of one place."""
        x, y = self.dots(np.array([[north_m, east_m]]))[0]
        return float(x), float(y)

    def place(self, x: float, y: float) -> tuple[float, float]:
        """North and east in metres of a dot."""
        turn = radians(self.up_deg)
        right, up = (x - self.width / 2.0) * self.m_per_dot, (self.height / 2.0 - y) * self.m_per_dot
        return (
            self.north_m + up * cos(turn) - right * sin(turn),
            self.east_m + up * sin(turn) + right * cos(turn),
        )

    def moved(self, right: float, up: float) -> "Projection":
        """The same, moved by shares of its width and height."""
        north, east = self.place(self.width * (0.5 + right), self.height * (0.5 - up))
        return self._replace(north_m=north, east_m=east)

    def zoomed(self, steps: int) -> "Projection":
        """Zoomed in by a number of steps, about the centre."""
        return self._replace(m_per_dot=min(COARSEST_M, max(FINEST_M, self.m_per_dot / ZOOM**steps)))

    def sized(self, width: int, height: int) -> "Projection":
        """The same centre and scale on a screen of another size."""
        return self._replace(width=width, height=height)

    def fitted(self, parts: Iterable[Plane], margin: int = 10) -> "Projection":
        """Middle and scale so that everything is seen, with a margin in dots."""
        upright = self._replace(north_m=0.0, east_m=0.0, m_per_dot=1.0, width=0, height=0)
        dots = [upright.dots(part[~np.isnan(part).any(axis=1)]) for part in parts]
        dots = [part for part in dots if len(part)]
        if not dots:
            return self
        everything = np.concatenate(dots)
        low, high = everything.min(axis=0), everything.max(axis=0)
        across, down = np.maximum(high - low, 2.0)
        scale = max(across / max(1, self.width - 2 * margin), down / max(1, self.height - 2 * margin))
        north, east = upright.place(*(low + high) / 2.0)
        return self._replace(north_m=north, east_m=east, m_per_dot=min(COARSEST_M, max(FINEST_M, float(scale))))


def round_length(most: float) -> float:
    """The longest of 1, 2, 5, 10, 20, 50… that is no longer."""
    decade = 10.0 ** floor(log10(most))
    return max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= most * (1.0 + 1e-9))


def length_text(metres: float) -> str:
    """`50 cm`, `20 m`, `1 km`."""
    if metres >= 1000.0:
        return f"{metres / 1000.0:g} km"
    return f"{metres:g} m" if metres >= 1.0 else f"{metres * 100.0:g} cm"
