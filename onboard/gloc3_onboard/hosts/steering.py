"""How an offset between two clocks is followed without steps: a pure object."""

from typing import Final

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
        """Moves towards another offset from now (local time) on."""
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
