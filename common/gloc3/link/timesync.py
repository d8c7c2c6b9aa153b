"""TIMESYNC: the offset between our clock and a peer's, from many round trips, the quickest of which count most."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final

import msgspec

from gloc3.link.message import Address, MavlinkMessage
from gloc3.link.service import Service

PERIOD_S: Final = 0.5
SAMPLES: Final = 20
CONVERGED_SAMPLES: Final = 5
JUMP_S: Final = 0.1
"""Samples that differ by more than this and their round trip come from another clock: the peer has restarted."""
JUMPS: Final = 3
"""So many in a row are believed."""
_NS: Final = 1_000_000_000


class TimeSample(msgspec.Struct, frozen=True):
    """One round trip."""

    offset_s: float
    """The peer's clock minus ours, if both ways took equally long; wrong by at most half the round trip."""
    round_trip_s: float
    t_s: float


class TimeSync(Service[TimeSample]):
    """Asks one peer for its time, and answers everybody who asks for ours.

    Args:
        own: as whom it speaks.
        peer: whose clock is wanted; None only answers.
        period_s: between two questions.
        tell_s: what is told as our time, in seconds; None where it is not known yet. By default the time of the owner.
    """

    handles = frozenset({"TIMESYNC"})

    def __init__(
        self,
        own: Address,
        peer: Address | None = None,
        *,
        period_s: float = PERIOD_S,
        tell_s: Callable[[float], float | None] = lambda now_s: now_s,
    ) -> None:
        super().__init__(own)
        self._peer = peer
        self._tell_s = tell_s
        self._period_s = period_s
        self._next_s = 0.0
        self._asked: deque[int] = deque(maxlen=16)
        self._samples: deque[TimeSample] = deque(maxlen=SAMPLES)
        self._strange: list[TimeSample] = []
        self.jumps = 0
        """Times that the peer's clock was believed to be another one."""

    def ask(self, peer: Address | None) -> None:
        """Wants the clock of this one from now on; what is known of another, or of an earlier life of it, is forgotten."""
        self._peer, self._next_s = peer, 0.0
        self._asked.clear()
        self._samples.clear()
        self._strange.clear()

    @property
    def is_converged(self) -> bool:
        """Whether there were enough round trips."""
        return len(self._samples) >= CONVERGED_SAMPLES

    @property
    def best(self) -> TimeSample | None:
        """The quickest of the last round trips; None before the first."""
        return min(self._samples, key=lambda sample: sample.round_trip_s, default=None)

    def to_own_s(self, peer_s: float) -> float | None:
        """A time of the peer's clock on ours; None before the first round trip."""
        best = self.best
        return None if best is None else peer_s - best.offset_s

    def to_peer_s(self, own_s: float) -> float | None:
        """A time of our clock on the peer's; None before the first round trip."""
        best = self.best
        return None if best is None else own_s + best.offset_s

    def receive(self, message: MavlinkMessage, sender: Address, now_s: float) -> None:
        """Answers a question, or takes an answer to one of ours."""
        if message.tc1 == 0:
            told_s = self._tell_s(now_s)
            if told_s is not None:
                self._send("TIMESYNC", tc1=max(1, round(told_s * _NS)), ts1=message.ts1)  # 0 would be a question again
        elif sender == self._peer and message.ts1 in self._asked:  # answers to others name times that we never asked
            self._asked.remove(message.ts1)
            asked_s = message.ts1 / _NS
            offset_s = message.tc1 / _NS - (asked_s + now_s) / 2.0
            self._take(TimeSample(offset_s, now_s - asked_s, now_s))

    def tick(self, now_s: float) -> None:
        """Asks when it is time."""
        if self._peer is None or now_s < self._next_s:
            return
        self._next_s = now_s + self._period_s
        asked = max(1, round(now_s * _NS))
        self._asked.append(asked)
        self._send("TIMESYNC", tc1=0, ts1=asked)

    def next_tick_s(self) -> float | None:
        """When the next question is due."""
        return None if self._peer is None else self._next_s

    def _take(self, sample: TimeSample) -> None:
        best = self.best
        if best is not None and abs(sample.offset_s - best.offset_s) > JUMP_S + sample.round_trip_s:
            self._strange.append(sample)
            if len(self._strange) < JUMPS:
                return
            self.jumps += 1
            self._samples.clear()
            self._samples.extend(self._strange)
        else:
            self._samples.append(sample)
        self._strange.clear()
        self._events.append(sample)
