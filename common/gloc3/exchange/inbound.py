"""Queue from other threads to the event loop: bounded, in order, with one wake-up for many messages."""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import Callable
from threading import Lock
from typing import Any, Final

DEPTH: Final = 1024
"""Default queue depth, in items, while the loop is busy."""
BATCH: Final = 64
"""So many are worked off before the loop does something else."""
BURST_S: Final = 2.0
"""Share of a rate limit that may come at once, s."""
REPORT_S: Final = 1.0
"""Drops by a limit are reported together, s."""
KEYS: Final = 256
"""Keys with a limit of their own; all further ones share one."""


class KeyLimit:
    """How often messages may come on each key: one sender can neither fill the loop nor keep the others out.

    Args:
        most_hz: rate for each key, 1/s; `BURST_S` of it may come at once.
        loop: its time, and where drops are reported.
        report: called in the loop with a key, and how many messages were dropped there in the last second.
    """

    def __init__(self, most_hz: float, loop: asyncio.AbstractEventLoop, report: Callable[[str, int], None]) -> None:
        self._most_hz, self._loop, self._report = most_hz, loop, report
        self._left: dict[str, tuple[float, float]] = {}
        self._dropped: Counter[str] = Counter()

    def passes(self, key: str) -> bool:
        """Whether a message may come in; called by one thread at a time."""
        now_s, room = self._loop.time(), self._most_hz * BURST_S
        if key not in self._left and len(self._left) >= KEYS:
            key = ""
        left, before_s = self._left.get(key, (room, now_s))
        left = min(room, left + (now_s - before_s) * self._most_hz)
        passes = left >= 1.0
        self._left[key] = (left - 1.0 if passes else left, now_s)
        if not passes:
            if not self._dropped:
                self._loop.call_soon_threadsafe(self._loop.call_later, REPORT_S, self._report_drops)
            self._dropped[key] += 1
        return passes

    def _report_drops(self) -> None:
        dropped, self._dropped = self._dropped, Counter()
        for key, number in dropped.items():
            self._report(key, number)


class Inbound:
    """Queue of one subscription. When it is full, the oldest item is dropped.

    Args:
        handle: called with each item, in the loop.
        depth: longest queue, items.
        limit: limits messages by their keys, before they are queued; None where all may come.
    """

    __slots__ = ("depth", "dropped", "handle", "limit", "waiting")

    def __init__(self, handle: Callable[[Any], None], depth: int = DEPTH, limit: KeyLimit | None = None) -> None:
        self.handle = handle
        self.depth = depth
        self.limit = limit
        self.dropped = 0
        """How many came while the loop was busy and were lost."""
        self.waiting: deque[Any] = deque()


class Arrivals:
    """All items that wait for the loop, in the order of arrival.

    Args:
        loop: the event loop that handles them.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._order: deque[Inbound] = deque()
        self._lock = Lock()
        self._is_awake = False
        self._is_open = True

    def receiver(self, inbound: Inbound) -> Callable[[Any], None]:
        """Returns the callback that queues items of a subscription, from any thread."""

        def handle(thing: Any) -> None:
            with self._lock:
                if inbound.limit is not None and self._is_open and not inbound.limit.passes(str(thing.key_expr)):
                    return
                if len(inbound.waiting) >= inbound.depth:
                    inbound.waiting.popleft()
                    inbound.dropped += 1
                else:
                    self._order.append(inbound)
                inbound.waiting.append(thing)
                has_to_wake = not self._is_awake and self._is_open
                self._is_awake = True
            if has_to_wake:
                self._loop.call_soon_threadsafe(self._drain)

        return handle

    def close(self) -> None:
        """Stops accepting items; queued ones are discarded. No thread wakes the loop after this."""
        with self._lock:
            self._is_open = False
            self._order.clear()

    def _drain(self) -> None:
        with self._lock:
            batch = [
                (inbound, inbound.waiting.popleft())
                for inbound in (self._order.popleft() for _ in range(min(BATCH, len(self._order))))
            ]
            has_more = self._is_awake = bool(self._order)
        if has_more:
            self._loop.call_soon(self._drain)
        for inbound, thing in batch:
            inbound.handle(thing)
