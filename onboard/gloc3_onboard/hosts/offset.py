"""The offset between two clocks, from questions and answers: a pure object."""

from collections import deque
from math import inf
from typing import Final, NamedTuple

DRIFT: Final = 100e-6
"""Seconds in a second: two computers' clocks drift apart no faster."""
KEPT: Final = 64
MOST_UNKNOWN: Final = 3
"""Consecutive contradicting answers after which a clock counts as reset."""
SLACK_S: Final = 1e-3


class OffsetEstimate(NamedTuple):
    """Estimate of an offset."""

    offset_s: float
    """The other clock minus ours."""
    bound_s: float
    """Largest error, however asymmetric the delay was."""
    round_trip_s: float
    age_s: float


UNKNOWN: Final = OffsetEstimate(0.0, inf, 0.0, 0.0)


class _Sample(NamedTuple):
    offset_s: float
    round_trip_s: float
    at_s: float


class OffsetFilter:
    """Keeps the answers with the tightest bound on the offset: short round trips that are still recent.

    The criterion is NTP's root distance: half the round trip plus the possible clock drift since (RFC 5905).
    """

    def __init__(self) -> None:
        self._samples: deque[_Sample] = deque(maxlen=KEPT)
        self._unknown_sources: list[_Sample] = []

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, requested_s: float, received_s: float, answered_s: float, arrived_s: float) -> None:
        """Takes an answer.

        Args:
            requested_s: when the question left, by our clock.
            received_s: when it came there, by the other.
            answered_s: when the answer left there, by the other.
            arrived_s: when it came here, by ours.
        """
        round_trip_s = max(0.0, (arrived_s - requested_s) - (answered_s - received_s))
        sample = _Sample(((received_s - requested_s) + (answered_s - arrived_s)) / 2.0, round_trip_s, arrived_s)
        known = self.estimate(arrived_s)
        if abs(sample.offset_s - known.offset_s) <= known.bound_s + round_trip_s / 2.0 + SLACK_S:
            self._unknown_sources.clear()
            self._samples.append(sample)
            return
        self._unknown_sources.append(sample)
        if len(self._unknown_sources) >= MOST_UNKNOWN:
            self._samples = deque(self._unknown_sources, KEPT)
            self._unknown_sources = []

    def estimate(self, now_s: float) -> OffsetEstimate:
        """What is known now, by our clock."""
        if not self._samples:
            return UNKNOWN
        best = min(self._samples, key=lambda sample: _distance_s(sample, now_s))
        return OffsetEstimate(best.offset_s, _distance_s(best, now_s), best.round_trip_s, now_s - best.at_s)


def _distance_s(sample: _Sample, now_s: float) -> float:
    return sample.round_trip_s / 2.0 + DRIFT * (now_s - sample.at_s)
