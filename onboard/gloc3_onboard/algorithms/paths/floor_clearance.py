"""Terrain following: keeps a height over ground or seabed by shifting the path up and down."""

from math import inf
from typing import Final

from gloc3.messages.frames import Quaternion, Vector3

NEAR_SHARE: Final = 0.5
"""Where it is lower than this share of the height that it keeps, it goes no further until it has climbed."""
UPRIGHT: Final = 0.7
"""Cosine of the tilt below which the range finder points too far sideways."""
SMOOTHING_S: Final = 0.4
"""Time constant of the smoothed range."""


class FloorClearance:
    """Vertical shift of a path that keeps its height over the floor, from ranges to what is below.

    The path is laid out level, and shifted with the floor under the vehicle. Over a floor that rises faster than the
    vehicle climbs, the height decreases, down to `NEAR_SHARE` of the wanted one, where the path waits.

    Args:
        altitude_m: the height to keep.
        drop_m: NED down of the path as laid out.
        climb_m_s: largest rate of the shift, up or down.
    """

    def __init__(self, altitude_m: float, drop_m: float, climb_m_s: float) -> None:
        self.blind_s = 0.0
        """Time since the last valid range."""
        self.left_s = 0.0
        """Time for the remaining shift, if the floor stays as it is."""
        self._altitude_m, self._drop_m, self._climb_m_s = altitude_m, drop_m, climb_m_s
        self._shift_m = 0.0
        self._floor_down_m: float | None = None
        self._height_m = inf

    def update(self, range_m: float | None, ned_from_frd: Quaternion, at: Vector3, duration_s: float) -> None:
        """Handles a downward range, and shifts the path.

        Args:
            range_m: along the body's down axis; None where there is no echo.
            ned_from_frd: attitude.
            at: position of the vehicle.
            duration_s: since the last update.
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
        """Whether the vehicle has to climb before it may continue."""
        return self._height_m < NEAR_SHARE * self._altitude_m

    def unmoved(self, place: Vector3) -> Vector3:
        """A point on the shifted path, shifted back."""
        return (place[0], place[1], place[2] - self._shift_m)

    def moved(self, place: Vector3) -> Vector3:
        """A point on the path, shifted."""
        return (place[0], place[1], place[2] + self._shift_m)
