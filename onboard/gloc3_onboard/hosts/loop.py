"""The event loop of a process that is not on the clock host: its time is the platform's all the same."""

import asyncio
from typing import Final

from gloc3.clock import monotonic_s
from gloc3_onboard.hosts.steering import Steering


class PlatformLoop(asyncio.SelectorEventLoop):
    """A loop whose `time()` is the platform's: this computer's monotonic clock and a steered offset.

    Args:
        offset_s: the platform's time minus this computer's, as far as it is known.
    """

    def __init__(self, offset_s: float = 0.0) -> None:
        self.steering: Final = Steering(offset_s)
        super().__init__()

    def time(self) -> float:
        """Seconds since boot of the clock host."""
        now_s = monotonic_s()
        return now_s + self.steering.offset_s(now_s)

    def steer(self, offset_s: float) -> None:
        """Approaches another offset, slowly enough that nobody who measures durations is misled."""
        self.steering.steer(offset_s, monotonic_s())

    def step(self, offset_s: float) -> None:
        """Takes another offset at once; only while nothing is scheduled that it would harm."""
        self.steering.step(offset_s)

    @property
    def offset_s(self) -> float:
        """The offset now."""
        return self.steering.offset_s(monotonic_s())
