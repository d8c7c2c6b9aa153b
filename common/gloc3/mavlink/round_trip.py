"""Retransmission timeout, estimated from round-trip times and raised after a loss."""

from __future__ import annotations

from typing import Final

SHORTEST_S: Final = 0.1
"""Shortest timeout, s: a Python peer may be busy for that long without having lost a message."""
LONGEST_S: Final = 2.0
UNKNOWN_S: Final = 0.4
RESTLESS_S: Final = 0.5
"""Patience grows to no more than this after losses, unless answers are known to take longer."""
_GROWTH: Final = 1.5


class RoundTrip:
    """Smoothed round-trip time and its variation (RFC 6298), and the patience that follows from them."""

    __slots__ = ("_factor", "_mean_s", "_variation_s")

    def __init__(self) -> None:
        self._mean_s: float | None = None
        self._variation_s = 0.0
        self._factor = 1.0

    @property
    def timeout_s(self) -> float:
        """How long to wait before asking again."""
        if self._mean_s is None:
            return min(UNKNOWN_S * self._factor, LONGEST_S)
        usual_s = min(max(self._mean_s + 4.0 * self._variation_s, SHORTEST_S), LONGEST_S)
        return min(usual_s * self._factor, max(usual_s, RESTLESS_S))

    def answered(self, after_s: float) -> None:
        """Adds the response time of a request that was sent once only."""
        if self._mean_s is None:
            self._mean_s, self._variation_s = after_s, after_s / 2.0
        else:
            self._variation_s += (abs(after_s - self._mean_s) - self._variation_s) / 4.0
            self._mean_s += (after_s - self._mean_s) / 8.0
        self._factor = 1.0

    def missed(self) -> None:
        """Grows more patient after an answer that did not come; the next clear answer ends that."""
        self._factor = min(self._factor * _GROWTH, 8.0)
