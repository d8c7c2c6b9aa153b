"""Terrain following: keeps a height over ground or seabed by shifting the path up and down."""

from math import inf
from typing import Final

from gloc3.messages.frames import Quaternion, Vector3

NEAR_SHARE: Final = 0.5
"""Where it is lower than this share of the height that it keeps, it goes no further until it has climbed."""
UPRIGHT: Final = 0.7
"""With a larger lean, the cosine of which is less, the range finder looks too far aside."""
SMOOTHING_S: Final = 0.4
"""Time constant of the mean over what the range finder tells."""


class FloorClearance:
    """Vertical shift of a path that keeps its height over the floor, from ranges to what is below.

    The way is laid level, and moved as the floor under the vehicle is: one that rises faster than the vehicle climbs is come
    nearer to, down to `NEAR_SHARE` of the height, where the way waits.

    Args:
        altitude_m: the height to keep.
        way_down_m: NED down of the way as it is laid.
        climb_m_s: how fast the way is moved up or down, at most.
    """

    def __init__(self, altitude_m: float, drop_m: float, climb_m_s: float) -> None:
        self.blind_s = 0.0
        """For so long no floor has been seen."""
        self.left_s = 0.0
        """So long the way is still moved, if the floor stays as it is."""
        self._altitude_m, self._drop_m, self._climb_m_s = altitude_m, drop_m, climb_m_s
        self._shift_m = 0.0
        self._floor_down_m: float | None = None
        self._height_m = inf

    def update(self, range_m: float | None, ned_from_frd: Quaternion, at: Vector3, duration_s: float) -> None:
        """Handles a range to what is below, and shifts the path.

        Args:
            range_m: along the body's down axis; None where there is no echo.
            ned_from_frd: attitude.
            at: where the vehicle is.
            duration_s: since the last time.
        """
        _, x, y, _ = ned_from_frd
        upright = 1.0 - 2.0 * (x * x + y * y)
        if range_m is None or upright < UPRIGHT:
            self.blind_s += duration_s
        else:
            self.blind_s, self._height_m = 0.0, range_m * upright
            floor_m = at[2] + self._height_m
            before_m = floor_m if self._floor_down_m is None else self._floor_down_m
            self._floor_down_m = before_m + min(1.0, duration_s / SMOOTHING_S) * (floor_m - before_m)
        if self._floor_down_m is not None:
            change_m = self._floor_down_m - self._altitude_m - self._drop_m - self._shift_m
            most_m = self._climb_m_s * duration_s
            self._shift_m += min(max(change_m, -most_m), most_m)
            self.left_s = max(0.0, abs(change_m) - most_m) / self._climb_m_s

    @property
    def is_too_near(self) -> bool:
        """Whether the vehicle has to climb before it may go on."""
        return self._height_m < NEAR_SHARE * self._altitude_m

    def unmoved(self, place: Vector3) -> Vector3:
        """A place on the shifted path, shifted back."""
        return (place[0], place[1], place[2] - self._shift_m)

    def moved(self, place: Vector3) -> Vector3:
        """A place on the path, shifted."""
        return (place[0], place[1], place[2] + self._shift_m)
