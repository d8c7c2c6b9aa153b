"""Event loop of a process outside the clock host; its time is the platform's."""

import asyncio
from typing import Final

from gloc3.clock import monotonic_s

SLEW: Final = 0.5e-3
"""Seconds in a second: the fastest that the offset changes."""


class Steering:
    """An offset that moves towards a wanted one at a limited rate.

    Args:
        offset_s: to begin with.
    """

    def __init__(self, offset_s: float = 0.0) -> None:
        self._from_s = self._to_s = offset_s
        self._since_s = 0.0
        """Local time since when it moves."""

    def step(self, offset_s: float) -> None:
        """Is there at once."""
        self._from_s = self._to_s = offset_s

    def steer(self, offset_s: float, now_s: float) -> None:
        """Slews to another offset from now (local time) on."""
        self._from_s, self._to_s, self._since_s = self.offset_s(now_s), offset_s, now_s

    def offset_s(self, now_s: float) -> float:
        """The offset at a local time."""
        elapsed_s = self._to_s - self._from_s
        if not elapsed_s:
            return self._to_s
        moved_s = SLEW * max(0.0, now_s - self._since_s)
        if moved_s >= abs(elapsed_s):
            return self._to_s
        return self._from_s + (moved_s if elapsed_s > 0.0 else -moved_s)


class PlatformLoop(asyncio.SelectorEventLoop):
    """An event loop whose `time()` is the platform's: the local monotonic clock plus a steered offset.

    Args:
        offset_s: the platform's time minus this computer's, as far as known.
    """

    def __init__(self, offset_s: float = 0.0) -> None:
        self.steering: Final = Steering(offset_s)
        super().__init__()

    def time(self) -> float:
        """Seconds since boot of the clock host."""
        now_s = monotonic_s()
        return now_s + self.steering.offset_s(now_s)

    def steer(self, offset_s: float) -> None:
        """Slews to another offset, slowly enough not to disturb measured durations."""
        self.steering.steer(offset_s, monotonic_s())

    def step(self, offset_s: float) -> None:
        """Takes another offset at once; only while nothing is scheduled that it would harm."""
        self.steering.step(offset_s)

    @property
    def offset_s(self) -> float:
        """The offset now."""
        return self.steering.offset_s(monotonic_s())
