"""Frames that were lost on the way, told by the gaps in their senders' numbers."""

from __future__ import annotations

from typing import Final

from gloc3.mavlink.parser import Frame

MOST_GAP: Final = 128
"""A larger step of the sequence is a restart or a late frame."""
MOST_SENDERS: Final = 256


class Gaps:
    """Counts what did not come, of each sender by itself; invented ones in masses find no room."""

    def __init__(self) -> None:
        self.lost = 0
        self._last: dict[int, int] = {}

    def hear(self, frame: Frame) -> None:
        """A frame has come."""
        key = frame.system << 8 | frame.component
        last = self._last.get(key)
        if last is not None and (gap := frame.sequence - last - 1 & 0xFF) < MOST_GAP:
            self.lost += gap
        if last is not None or len(self._last) < MOST_SENDERS:
            self._last[key] = frame.sequence
