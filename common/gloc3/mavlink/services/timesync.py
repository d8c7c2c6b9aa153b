"""TIMESYNC: the offset between our clock and a peer's, from many round trips, the quickest of which count most."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import inf
from typing import Final

import msgspec

from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.service import Microservice

PERIOD_S: Final = 0.5
SAMPLES: Final = 20
CONVERGED_SAMPLES: Final = 5
JUMP_S: Final = 0.1
"""Difference between samples, beyond their round trip, that shows that the peer's clock has stopped or restarted, s."""
JUMPS: Final = 3
"""So many in a row are believed."""
BACK_S: Final = 0.5
"""Decrease of a peer's clock that shows a restart, s."""
_NS: Final = 1_000_000_000


class TimeSample(msgspec.Struct, frozen=True):
    """One round trip."""

    offset_s: float
    """The peer's clock minus ours, assuming equal delays in both directions; wrong by at most half the round trip."""
    round_trip_s: float
    t_s: float
    is_back: bool = False
    """Whether the peer's time is earlier than one it had reported before the request; false for a clock that stands
    still."""


class TimeSync(Microservice[TimeSample]):
    """Requests one peer's time, and answers all requests for ours.

    Args:
        own: address of this end.
        peer: the peer whose clock is requested; None only answers.
        period_s: between two requests.
        send_s: our time to send, in seconds; None while it is unknown. By default the owner's time.
    """

    handles = frozenset({"TIMESYNC"})

    def __init__(
        self,
        own: Address,
        peer: Address | None = None,
        *,
        period_s: float = PERIOD_S,
        send_s: Callable[[float], float | None] = lambda now_s: now_s,
    ) -> None:
        super().__init__(own)
        self._peer = peer
        self._send_s = send_s
        self._period_s = period_s
        self._next_s = 0.0
        self._requested: deque[int] = deque(maxlen=16)
        self._samples: deque[TimeSample] = deque(maxlen=SAMPLES)
        self._strange: list[TimeSample] = []
        self._reported_s, self._reported_at_s = -inf, 0.0
        """The peer's last reported time, and when it was reported."""
        self.restarts = 0
        """Detected restarts of the peer's clock."""

    def request(self, peer: Address | None) -> None:
        """Requests the clock of this peer from now on; the state of another, or of its earlier life, is discarded."""
        self._peer, self._next_s = peer, 0.0
        self._requested.clear()
        self._samples.clear()
        self._strange.clear()
        self._reported_s = -inf

    @property
    def is_converged(self) -> bool:
        """Whether there were enough round trips."""
        return len(self._samples) >= CONVERGED_SAMPLES

    @property
    def best(self) -> TimeSample | None:
        """The quickest of the last round trips; None before the first."""
        return min(self._samples, key=lambda sample: sample.round_trip_s, default=None)

    def to_peer_s(self, own_s: float) -> float | None:
        """Converts a time of our clock to the peer's; None before the first round trip."""
        best = self.best
        return None if best is None else own_s + best.offset_s

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Answers a request, or handles an answer to one of ours."""
        if message.tc1 == 0:
            reported_s = self._send_s(now_s)
            if reported_s is not None:
                self._send(
                    "TIMESYNC", tc1=max(1, round(reported_s * _NS)), ts1=message.ts1
                )  # 0 would be a question again
        elif (
            sender == self._peer and message.ts1 in self._requested
        ):  # answers to others name times that we never asked
            self._requested.remove(message.ts1)
            requested_s, reported_s = message.ts1 / _NS, message.tc1 / _NS
            is_back = requested_s >= self._reported_at_s and reported_s < self._reported_s - BACK_S
            if reported_s > self._reported_s:
                self._reported_s, self._reported_at_s = reported_s, now_s
            self._add_sample(TimeSample(reported_s - (requested_s + now_s) / 2.0, now_s - requested_s, now_s, is_back))

    def tick(self, now_s: float) -> None:
        """Asks when it is time."""
        if self._peer is None or now_s < self._next_s:
            return
        self._next_s = now_s + self._period_s
        requested = max(1, round(now_s * _NS))
        self._requested.append(requested)
        self._send("TIMESYNC", tc1=0, ts1=requested)

    def next_tick_s(self) -> float | None:
        """When the next question is due."""
        return None if self._peer is None else self._next_s

    def _add_sample(self, sample: TimeSample) -> None:
        self._events.append(sample)
        best = self.best
        if best is not None and abs(sample.offset_s - best.offset_s) > JUMP_S + sample.round_trip_s:
            self._strange.append(sample)
            if len(self._strange) < JUMPS:
                return
            if all(strange.is_back for strange in self._strange):
                self.restarts += 1
                self._reported_s = -inf
            self._samples.clear()
            self._samples.extend(self._strange)
        else:
            self._samples.append(sample)
        self._strange.clear()
