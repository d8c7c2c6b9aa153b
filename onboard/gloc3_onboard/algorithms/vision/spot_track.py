"""Which of the bright spots is the vehicle's lamp: by how it has moved before."""

import math
from typing import Final

from gloc3_onboard.algorithms.vision.bright_spots import Spot

CONFIRMED_AFTER: Final = 3
"""Pictures in a row with one spot that moves steadily, until it is the lamp."""
DOUBTED_AFTER_S: Final = 0.5
"""After so long out of sight, what is where it could be has to be seen as often again."""
FORGOTTEN_AFTER_S: Final = 2.0
"""After so long out of sight, nothing is expected any more."""
_LOOSE_PX: Final = 10.0
"""What noise and a shaking stand may move a spot by."""
_VELOCITY_GAIN: Final = 0.4


class SpotTrack:
    """Follows one spot; a second one that comes near is never taken for it, nor is a choice made between two."""

    def __init__(self) -> None:
        self._place: tuple[float, float] | None = None
        self._velocity = (0.0, 0.0)
        self._seen_s = -math.inf
        self._count = 0

    @property
    def is_confirmed(self) -> bool:
        """Whether the spot has been seen often enough."""
        return self._count >= CONFIRMED_AFTER

    def silent_s(self, t_s: float) -> float:
        """For how long it was not seen."""
        return t_s - self._seen_s

    def forget(self) -> None:
        """Expects nothing."""
        self._place, self._count, self._velocity = None, 0, (0.0, 0.0)

    def take(self, spots: list[Spot], t_s: float, most_px_s2: float) -> tuple[Spot | None, str]:
        """Finds the lamp among the spots of a new picture.

        Args:
            spots: What there is.
            t_s: When.
            most_px_s2: How fast the lamp's motion in the picture may change.

        Returns:
            The lamp, or None and why not.
        """
        ahead_s = t_s - self._seen_s
        if self._place is not None and ahead_s > FORGOTTEN_AFTER_S:
            self.forget()
        if self._place is None:
            return self._first(spots, t_s)
        x, y = (self._place[i] + self._velocity[i] * ahead_s for i in (0, 1))
        reach_px = _LOOSE_PX + 0.5 * most_px_s2 * ahead_s**2 + (0.0 if self._count > 1 else most_px_s2 * ahead_s)
        near = [spot for spot in spots if math.hypot(spot.column - x, spot.row - y) <= reach_px]
        if len(near) > 1:
            return None, "two lights"
        if not near:
            if not self.is_confirmed:
                self.forget()
            return None, "a light, but not where the vehicle's could be" if spots else "no light in sight"
        if ahead_s > DOUBTED_AFTER_S and self.is_confirmed:
            self.forget()
            return self._first(near, t_s)
        self._follow(near[0], ahead_s, t_s)
        return (near[0], "") if self.is_confirmed else (None, "a light appears")

    def _first(self, spots: list[Spot], t_s: float) -> tuple[None, str]:
        if len(spots) != 1:
            return None, "two lights" if spots else "no light in sight"
        self._place, self._seen_s, self._count = (spots[0].column, spots[0].row), t_s, 1
        return None, "a light appears"

    def _follow(self, spot: Spot, ahead_s: float, t_s: float) -> None:
        old, place = self._place or (spot.column, spot.row), (spot.column, spot.row)
        gain = 1.0 if self._count == 1 else _VELOCITY_GAIN
        vx, vy = ((place[i] - old[i]) / ahead_s for i in (0, 1))
        self._velocity = (
            self._velocity[0] + gain * (vx - self._velocity[0]),
            self._velocity[1] + gain * (vy - self._velocity[1]),
        )
        self._place, self._seen_s, self._count = place, t_s, self._count + 1
