"""Finds the rate of a serial line: the one at which MAVLink frames with right checksums come in."""

from __future__ import annotations

from typing import Final

from gloc3.mavlink.codec import Parser

RATES: Final = (57_600, 115_200, 921_600, 460_800, 230_400, 500_000, 1_500_000, 38_400)
"""As autopilots' ports and radios are set, the most usual ones first."""
TRY_S: Final = 1.3
"""Longer than the second between two heartbeats."""
ENOUGH: Final = 2
"""Frames that must come: one might be chance."""


class BaudSearch:
    """Tries one rate after the other. It has no clock and no port: it is told what is heard, and says what to try."""

    def __init__(self, now_s: float) -> None:
        self.is_found = False
        self._index = 0
        self._begin(now_s)

    @property
    def rate(self) -> int:
        """The rate that is right, or is being tried."""
        return RATES[self._index]

    def hear(self, data: bytes, now_s: float) -> None:
        """Takes in what was heard at the present rate, which may be nothing."""
        if self.is_found:
            return
        self._frames += sum(frame.shape is not None for frame in self._parser.receive(data))
        if self._frames >= ENOUGH:
            self.is_found = True
        elif now_s - self._began_s > TRY_S * (2.0 if self._frames else 1.0):
            self._index = (self._index + 1) % len(RATES)
            self._begin(now_s)

    def _begin(self, now_s: float) -> None:
        self._began_s, self._frames, self._parser = now_s, 0, Parser()
