"""Reasons in words for what was refused, few enough at a time that a flood of requests makes no flood of texts."""

from collections.abc import Callable
from typing import Final

MOST: Final = 8
"""In a period; what is more is counted and told at its end."""
PERIOD_S: Final = 5.0


class Reasons:
    """Tells reasons.

    Args:
        tell: takes one.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self.said = 0
        """Reasons so far, told or not."""
        self._tell = tell
        self._now_s = 0.0
        self._in_period = self._untold = 0
        self._ends_s: float | None = None

    def say(self, text: str) -> None:
        """Tells a reason, unless too many were told just before."""
        self.said += 1
        if self._in_period >= MOST:
            self._untold += 1
            return
        self._in_period += 1
        if self._ends_s is None:
            self._ends_s = self._now_s + PERIOD_S
        self._tell(text)

    def tick(self, now_s: float) -> None:
        """Begins a new period when it is time."""
        self._now_s = now_s
        if self._ends_s is None or now_s < self._ends_s:
            return
        untold, self._untold, self._in_period, self._ends_s = self._untold, 0, 0, None
        if untold:
            self._tell(f"and {untold} more refusals")

    def next_tick_s(self) -> float | None:
        """When the period ends."""
        return self._ends_s
