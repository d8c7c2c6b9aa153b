"""State of the path to one peer: round-trip time, loss, and clock offset."""

from __future__ import annotations

from collections import deque
from typing import Final

import msgspec

FIRST_GUESS_S: Final = 0.8
SMALLEST_VARIATION_S: Final = 0.05
SHORTEST_OF_S: Final = 20.0
"""The shortest round trip is that of the last 20 to 40 s."""
CLOCK_SAMPLES: Final = 12
FIRST_LOSS: Final = 0.2
"""Before anything is known."""


class RoundTrips:
    """Smoothed round trip and its variation (RFC 6298), the shortest of late, and the loss of data frames."""

    __slots__ = ("_before_s", "_has_sample", "_recent_s", "_since_s", "_variation_s", "loss", "smoothed_s")

    def __init__(self) -> None:
        self.smoothed_s = FIRST_GUESS_S
        self.loss = FIRST_LOSS
        """Fraction of data frames to the peer that are lost."""
        self._variation_s = FIRST_GUESS_S / 2.0
        self._has_sample = False
        self._recent_s = self._before_s = float("inf")
        self._since_s = 0.0

    @property
    def timeout_s(self) -> float:
        """How long an answer may take before it is missed."""
        return self.smoothed_s + max(SMALLEST_VARIATION_S, 4.0 * self._variation_s)

    def sample(self, round_trip_s: float, now_s: float) -> float:
        """Adds a measured round trip; returns its excess over the shortest recent one."""
        if not self._has_sample:
            self._has_sample = True
            self.smoothed_s, self._variation_s = round_trip_s, round_trip_s / 2.0
        else:
            self._variation_s += 0.25 * (abs(round_trip_s - self.smoothed_s) - self._variation_s)
            self.smoothed_s += 0.125 * (round_trip_s - self.smoothed_s)
        if now_s - self._since_s > SHORTEST_OF_S:
            self._before_s, self._recent_s, self._since_s = self._recent_s, float("inf"), now_s
        self._recent_s = min(self._recent_s, round_trip_s)
        return round_trip_s - min(self._recent_s, self._before_s)

    def count(self, sent: int, arrived: int) -> None:
        """Takes in how many of the last data frames arrived."""
        if sent > 0:
            weight = min(0.5, sent / 64.0)
            self.loss += weight * (min(1.0, max(0.0, 1.0 - arrived / sent)) - self.loss)


class ClockSample(msgspec.Struct, frozen=True):
    """One exchange of greetings."""

    offset_s: float
    """The peer's clock minus ours; wrong by at most half the round trip."""
    round_trip_s: float


class PeerClock:
    """The peer's clock against ours: the exchange with the shortest round trip of the last few counts."""

    __slots__ = ("_samples",)

    def __init__(self) -> None:
        self._samples: deque[ClockSample] = deque(maxlen=CLOCK_SAMPLES)

    def sample(self, requested_s: float, reported_s: float, held_s: float, now_s: float) -> float | None:
        """Adds a clock sample from an echo.

        Args:
            requested_s: when our hello was sent, by our clock.
            reported_s: when the peer's hello was sent, by its clock.
            held_s: how long the peer had held our hello by then.
            now_s: when the peer's hello was received, by our clock.

        Returns:
            The round trip; None for an implausible echo.
        """
        round_trip_s = now_s - requested_s - held_s
        if not 0.0 <= round_trip_s < 60.0:
            return None
        self._samples.append(ClockSample(reported_s + 0.5 * round_trip_s - now_s, round_trip_s))
        return round_trip_s

    @property
    def best(self) -> ClockSample | None:
        """The best exchange; None before the first."""
        return min(self._samples, key=lambda sample: sample.round_trip_s, default=None)

    @property
    def latest(self) -> ClockSample | None:
        """The last exchange; None before the first."""
        return self._samples[-1] if self._samples else None
