"""A link in memory between two ends, with seeded latency, loss, duplication, reordering and bandwidth."""

from __future__ import annotations

from collections.abc import Callable
from heapq import heappop, heappush
from random import Random
from typing import Any, Final, Protocol

import msgspec


class Scheduler(Protocol):
    """The part of an event loop that a link needs."""

    def time(self) -> float:
        """Now, in seconds."""

    def call_at(self, when: float, callback: Callable[..., Any], /, *args: Any) -> object:
        """Calls back at a time."""


class Conditions(msgspec.Struct, frozen=True, kw_only=True):
    """Effects of one direction of a link on what is sent over it. The default is a perfect cable."""

    latency_s: float = 0.0
    jitter_s: float = 0.0
    """Latency is longer by up to this, uniformly; the order is kept."""
    loss: float = 0.0
    """Probability that one `send` (a frame, a datagram) never arrives; 1 is a cut cable."""
    duplicate: float = 0.0
    """Probability that one arrives twice."""
    reorder: float = 0.0
    """Probability that one is held back by `reorder_s` and overtaken."""
    reorder_s: float = 0.05
    bandwidth_bit_s: float | None = None
    """Bits per second on the line; None for a line without a limit."""
    bits_per_byte: float = 8.0
    """10 for a serial line with start and stop bits (8N1)."""
    queue_bytes: int = 4096
    """What may wait for a limited line; what does not fit any more is dropped."""


PERFECT: Final = Conditions()
ACOUSTIC: Final = Conditions(latency_s=2.0, jitter_s=1.0, loss=0.1, bandwidth_bit_s=80.0, queue_bytes=64)
"""An acoustic modem over some 3 km of water; both directions share the line (`is_half_duplex`)."""


class MemoryEnd:
    """One end of a link: an endpoint without a socket."""

    is_datagram = True
    intruder = ""
    origin = ""
    problem = ""
    local_port = None

    def __init__(self, link: MemoryLink, name: str) -> None:
        self.url = f"memory:{name}"
        self.on_data: Callable[[bytes], None] | None = None
        """Called with each piece that arrives; pieces that arrive while it is None are lost."""
        self.conditions = link.conditions
        """For data that this end sends; may be replaced at any time."""
        self.sent = 0
        self.lost = 0
        """Pieces lost in transit, by chance."""
        self.dropped = 0
        """Pieces dropped before transit: the queue of a limited line was full."""
        self.received = 0
        self.bytes_sent = 0
        self.bytes_received = 0
        self._link = link
        self._line = _Line()
        self._other: MemoryEnd
        self._arriving: list[tuple[float, int, bytes]] = []
        self._wake_s: float | None = None
        self._last_s = 0.0

    @property
    def is_connected(self) -> bool:
        """Whether the other end is open."""
        return self._other.on_data is not None

    def send(self, data: bytes) -> None:
        """Sends one frame or datagram, or a piece of a stream."""
        link, conditions, now_s = self._link, self.conditions, self._link.loop.time()
        leaves_s = now_s
        if conditions.bandwidth_bit_s is not None:
            bytes_per_s = conditions.bandwidth_bit_s / conditions.bits_per_byte
            begins_s = max(now_s, self._line.busy_until_s)
            if (begins_s - now_s) * bytes_per_s + len(data) > conditions.queue_bytes:
                self.dropped += 1
                return
            leaves_s = self._line.busy_until_s = begins_s + len(data) / bytes_per_s
        self.sent += 1
        self.bytes_sent += len(data)
        chance = link.random
        if conditions.loss and chance.random() < conditions.loss:
            self.lost += 1
            return
        arrives_s = leaves_s + conditions.latency_s
        if conditions.jitter_s:
            arrives_s += chance.random() * conditions.jitter_s
        if conditions.reorder and chance.random() < conditions.reorder:
            self._other._expect(arrives_s + conditions.reorder_s, data)
            return
        arrives_s = self._last_s = max(arrives_s, self._last_s)
        self._other._expect(arrives_s, data)
        if conditions.duplicate and chance.random() < conditions.duplicate:
            self._other._expect(arrives_s, data)

    async def close(self) -> None:
        """Receives nothing more until `on_data` is set again."""
        self.on_data = None

    def _expect(self, arrives_s: float, data: bytes) -> None:
        link = self._link
        link.count += 1
        heappush(self._arriving, (arrives_s, link.count, data))
        self._wake(arrives_s)

    def _wake(self, when_s: float) -> None:
        if self._wake_s is None or when_s < self._wake_s:
            self._wake_s = when_s
            self._link.loop.call_at(when_s, self._deliver)

    def _deliver(self) -> None:
        self._wake_s = None
        now_s, arriving = self._link.loop.time(), self._arriving
        while arriving and arriving[0][0] <= now_s:
            data = heappop(arriving)[2]
            self.received += 1
            self.bytes_received += len(data)
            if self.on_data is not None:
                self.on_data(data)
        if arriving:
            self._wake(arriving[0][0])


class _Line:
    """What is sent over a limited line goes one after the other."""

    __slots__ = ("busy_until_s",)

    def __init__(self) -> None:
        self.busy_until_s = 0.0


class MemoryLink:
    """Two ends, `a` and `b`; data sent by one arrives at the other after a delay, or is lost.

    Args:
        loop: the event loop, for time and timers.
        random: the seeded random source of this link.
        conditions: initial ones of both directions; replace an end's `conditions` to change them.
        is_half_duplex: both directions share one limited line, as on a radio.
    """

    def __init__(
        self, loop: Scheduler, random: Random, conditions: Conditions = PERFECT, *, is_half_duplex: bool = False
    ) -> None:
        self.loop = loop
        self.random = random
        self.conditions = conditions
        self.count = 0
        """Pieces sent so far; keeps those of the same instant in order."""
        self.a, self.b = MemoryEnd(self, "a"), MemoryEnd(self, "b")
        self.a._other, self.b._other = self.b, self.a
        if is_half_duplex:
            self.b._line = self.a._line

    def set_conditions(self, conditions: Conditions) -> None:
        """Changes both directions at once."""
        self.a.conditions = self.b.conditions = conditions
