"""Order of a device's data in time: new, from the past or future, and silence."""

from math import isfinite
from typing import Final, NamedTuple

AHEAD_S: Final = 0.05
"""Accepted lead of a stamp over our time, s: clocks are mapped with some error."""
ADOPTED_AFTER: Final = 5
"""Ordered stamps before the last good one after which the device's clock counts as restarted."""


class Arrival(NamedTuple):
    """Something new."""

    t_s: float
    """Time of validity; the present if its own is not plausible."""
    problem: str
    """Why its stamp cannot be believed; empty where it can."""


class StampMonitor:
    """Checks the stamps of one device.

    Args:
        what: name of one datum of the device, such as *picture*.
        silent_s: time without new data after which the device counts as silent, and age above which data are stale.
    """

    def __init__(self, what: str, silent_s: float) -> None:
        self._what, self._silent_s = what, silent_s
        self._good_s = float("-inf")
        self._seen_s: float | None = None
        self._in_order = 0
        self._came_s: float | None = None
        self._reported_s = float("-inf")

    def judge(self, t_s: float, now_s: float) -> Arrival | None:
        """Judges a stamp; None for one that was seen last, too."""
        previous_s, self._seen_s = self._seen_s, t_s
        if t_s == previous_s:
            return None
        self._came_s = now_s
        if not isfinite(t_s):
            return Arrival(now_s, f"the {self._what} has no time of validity")
        if t_s > now_s + AHEAD_S:
            return Arrival(now_s, f"the {self._what} is stamped {t_s - now_s:.2f} s ahead of the present")
        if t_s < now_s - self._silent_s:
            return Arrival(t_s, f"the {self._what} is {now_s - t_s:.1f} s old")
        if t_s <= self._good_s:
            self._in_order = self._in_order + 1 if previous_s is not None and t_s > previous_s else 1
            if self._in_order < ADOPTED_AFTER:
                return Arrival(now_s, f"time goes back by {self._good_s - t_s:.3f} s")
        self._good_s, self._in_order = t_s, 0
        return Arrival(t_s, "")

    def silence(self, now_s: float) -> str:
        """Why nothing comes, once in each period of silence; else an empty text."""
        if self._came_s is None:
            self._came_s = now_s
        if now_s - max(self._came_s, self._reported_s) < self._silent_s - 1e-9:
            return ""
        self._reported_s = now_s
        return f"no {self._what} for {now_s - self._came_s:.1f} s"
