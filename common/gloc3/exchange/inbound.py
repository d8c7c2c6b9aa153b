"""Queue from other threads to the event loop: bounded, in order, with one wake-up for many messages."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from threading import Lock
from typing import Any, Final

DEPTH: Final = 1024
"""Default queue depth, in items, while the loop is busy."""
BATCH: Final = 64
"""So many are worked off before the loop does something else."""


class Inbound:
    """Queue of one subscription. When it is full, the oldest item is dropped.

    Args:
        handle: called with each item, in the loop.
        depth: longest queue, items.
    """

    __slots__ = ("depth", "dropped", "handle", "waiting")

    def __init__(self, handle: Callable[[Any], None], depth: int = DEPTH) -> None:
        self.handle = handle
        self.depth = depth
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
