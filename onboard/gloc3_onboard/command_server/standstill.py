"""Notices that the whole process has stood still: nobody could be heard meanwhile, and so nobody was silent."""

from math import inf
from typing import Final

STOOD_STILL_S: Final = 0.3
"""A cycle that comes so long after the one before: less than the shortest silence from which anything follows."""
UNUSUAL: Final = 3.0
"""So many times the pause before that: its rate can be set, too."""
CATCH_UP_S: Final = 0.5
"""So long after it what was told meanwhile may take to come in; nothing is judged by silence until then."""
AGAIN_S: Final = 2.0
"""Not again so soon after it: a process that never has time is one that has no time."""


class Standstill:
    """Follows the times of the cycles."""

    def __init__(self) -> None:
        self._before_s, self._pause_s = inf, 0.0
        self._until_s = -inf

    def look(self, now_s: float) -> float:
        """Takes the time of a cycle.

        Returns:
            For how long the process has stood still, in the first cycle after it; else 0.
        """
        usual_s, pause_s = self._pause_s, now_s - self._before_s
        self._before_s, self._pause_s = now_s, pause_s
        if pause_s <= max(STOOD_STILL_S, UNUSUAL * usual_s) or now_s < self._until_s + AGAIN_S:
            return 0.0
        self._until_s = now_s + CATCH_UP_S
        return pause_s

    def is_over(self, now_s: float) -> bool:
        """Whether silence counts."""
        return now_s >= self._until_s
