"""Queue from other threads to the event loop: bounded, in order, with one wake-up for many messages."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from threading import Lock
from typing import Any, Final

DEPTH: Final = 1024
"""So many things may wait for a loop that is busy, where nothing else is said."""
BATCH: Final = 64
"""So many are worked off before the loop does something else."""


class Inbound:
    """What waits of one subscription. When it is full the oldest makes place.

    Args:
        take: is given each thing, in the loop.
        depth: so many may wait.
    """

    __slots__ = ("depth", "dropped", "handle", "waiting")

    def __init__(self, handle: Callable[[Any], None], depth: int = DEPTH) -> None:
        self.handle = handle
        self.depth = depth
        self.dropped = 0
        """How many came while the loop was busy and were lost."""
        self.waiting: deque[Any] = deque()


class Arrivals:
    """Everything that waits for the loop, in the order in which it came.

    Args:
        loop: takes it.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._order: deque[Inbound] = deque()
        self._lock = Lock()
        self._is_awake = False
        self._is_open = True

    def receiver(self, inbound: Inbound) -> Callable[[Any], None]:
        """Takes what comes for a subscription, in any thread."""

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
        """Takes nothing any more; what waits is forgotten. No thread wakes the loop after this."""
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
