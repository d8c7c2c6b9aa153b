"""Keeps a distance from the wall ahead by shifting the path (paper §VI: visual inspection)."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from gloc3.messages.frames import Vector3

VIEW_RAD: Final = math.radians(40.0)
"""Search range for the wall, to both sides of the vehicle's heading…"""
FARTHEST_M: Final = 8.0
"""and no farther away."""
PIECE_M: Final = 1.5
"""What counts of it lies so near to its nearest point."""
FEWEST: Final = 5
ROUGH_M: Final = 0.1
"""Roughness above which a piece is a corner or clutter, m; the path then keeps its shift."""
MOST_M: Final = 1.5
"""Largest shift of the path, m; its rate is limited below."""
SPEED_M_S: Final = 0.4


class WallAhead(NamedTuple):
    """Distance and direction of the wall ahead."""

    distance_m: float
    """Square to the wall."""
    toward_ne: tuple[float, float]
    """Unit vector from the vehicle to it."""


def wall_ahead(points_ne_m: Sequence[tuple[float, float]], at: Vector3, heading_rad: float) -> WallAhead | None:
    """The straight wall ahead of a vehicle, from the points of a scan; None if there is none."""
    offset = np.array(points_ne_m, np.float64).reshape(-1, 2) - at[:2]
    distance = np.hypot(*offset.T)
    off = np.arctan2(offset[:, 1], offset[:, 0]) - heading_rad
    is_ahead = (np.abs((off + math.pi) % (2.0 * math.pi) - math.pi) < VIEW_RAD) & (distance < FARTHEST_M)
    if not is_ahead.any():
        return None
    ahead = offset[is_ahead]
    nearest = ahead[int(np.argmin(distance[is_ahead]))]
    piece = ahead[np.hypot(*(ahead - nearest).T) < PIECE_M]
    if len(piece) < FEWEST:
        return None
    middle = piece.mean(axis=0)
    _, sizes, axes = np.linalg.svd(piece - middle, full_matrices=False)
    if sizes[1] / math.sqrt(len(piece)) > ROUGH_M or sizes[1] > 0.5 * sizes[0]:
        return None
    square_m = float(axes[1] @ middle)
    north, east = (axes[1] * math.copysign(1.0, square_m)).tolist()
    return WallAhead(abs(square_m), (north, east))


class WallDistance:
    """Horizontal shift of a path that keeps its distance from the wall ahead."""

    def __init__(self, distance_m: float) -> None:
        self._distance_m = distance_m
        self._shift: tuple[float, float] = (0.0, 0.0)
        self.blind_s = 0.0
        """Time without a visible wall, s."""

    def unmoved(self, place: Vector3) -> Vector3:
        """A position on the shifted path, shifted back."""
        return (place[0] - self._shift[0], place[1] - self._shift[1], place[2])

    def moved(self, place: Vector3) -> Vector3:
        """A position on the path, shifted."""
        return (place[0] + self._shift[0], place[1] + self._shift[1], place[2])

    def update(self, wall: WallAhead | None, vehicle: Vector3, target: Vector3, duration_s: float) -> None:
        """Handles the wall ahead, and shifts the path.

        Args:
            wall: the wall.
            vehicle: the vehicle's position.
            target: target on the unshifted path.
            duration_s: time since the last call.
        """
        if wall is None:
            self.blind_s += duration_s
            return
        self.blind_s = 0.0
        north, east = wall.toward_ne
        target_m = wall.distance_m - (target[0] - vehicle[0]) * north - (target[1] - vehicle[1]) * east
        wanted_m = min(max(target_m - self._distance_m, -MOST_M), MOST_M)
        change = (wanted_m * north - self._shift[0], wanted_m * east - self._shift[1])
        size_m = math.hypot(*change)
        share = min(1.0, SPEED_M_S * duration_s / size_m) if size_m > 0.0 else 0.0
        self._shift = (self._shift[0] + share * change[0], self._shift[1] + share * change[1])
