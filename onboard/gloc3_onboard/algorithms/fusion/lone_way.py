"""The way of an odometer that is left alone, and the error of its scale that is claimed for it."""

import numpy as np

from gloc3.messages.frames import Vector3


class LoneWay:
    """The way since a place, and the error of scale that has been claimed for it."""

    def __init__(self, begin_ned_m: Vector3) -> None:
        self._begin_ned_m = begin_ned_m
        self._claimed_m2 = np.zeros(3)

    def grow(self, place_ned_m: Vector3, scale_std: float) -> Vector3:
        """By how much more the position is uncertain along each axis, m, as a standard deviation beside that before."""
        # The same error for the whole way: the variance grows as (s d)^2; a way back takes nothing away.
        square_m2 = (scale_std * np.subtract(place_ned_m, self._begin_ned_m)) ** 2
        more_m2 = np.maximum(square_m2 - self._claimed_m2, 0.0)
        self._claimed_m2 += more_m2
        north, east, down = np.sqrt(more_m2).tolist()
        return north, east, down
