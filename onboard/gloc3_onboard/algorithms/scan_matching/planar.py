"""Poses in a level plane: x forward or north, y right or east, headings clockwise seen from above."""

from math import cos, hypot, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3.messages.frames import wrap_pi

Array = NDArray[np.float64]
"""Points have shape (n, 2), in metres."""


class Planar(NamedTuple):
    """A pose in the plane, or a motion: `a_from_b`."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0

    def __matmul__(self, other: "Planar") -> "Planar":
        """`a_from_c = a_from_b @ b_from_c`."""
        c, s = cos(self.yaw_rad), sin(self.yaw_rad)
        return Planar(
            self.x_m + c * other.x_m - s * other.y_m,
            self.y_m + s * other.x_m + c * other.y_m,
            wrap_pi(self.yaw_rad + other.yaw_rad),
        )

    def inverse(self) -> "Planar":
        """`b_from_a`."""
        c, s = cos(self.yaw_rad), sin(self.yaw_rad)
        return Planar(-c * self.x_m - s * self.y_m, s * self.x_m - c * self.y_m, -self.yaw_rad)

    def rotation(self) -> Array:
        """The 2 by 2 matrix."""
        c, s = cos(self.yaw_rad), sin(self.yaw_rad)
        return np.array(((c, -s), (s, c)))

    def apply(self, points: Array) -> Array:
        """Points of b in the axes of a."""
        moved: Array = points @ self.rotation().T
        moved += (self.x_m, self.y_m)
        return moved

    @property
    def distance_m(self) -> float:
        """How far b's origin is from a's."""
        return hypot(self.x_m, self.y_m)

    def part(self, share: float) -> "Planar":
        """A share of a short motion."""
        return Planar(self.x_m * share, self.y_m * share, self.yaw_rad * share)
