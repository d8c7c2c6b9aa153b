"""Any topic of the platform as a device of the viewer; unwatched topics cost nothing."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from gloc3.exchange.base import Exchange, Unsubscribe
from gloc3.messages.envelope import Envelope
from gloc3_onboard.sensors.devices import Tap


class ExchangeTaps:
    """The topics of the platform's exchange, which is only touched in the loop's thread."""

    def __init__(self, exchange: Exchange, loop: asyncio.AbstractEventLoop, platform: str) -> None:
        self._exchange = exchange
        self._loop = loop
        self._platform = platform

    def open(self, topic: str, reports: Callable[[], None] | None = None) -> Tap:
        """Listens to a topic."""
        return ExchangeTap(self._exchange, self._loop, f"{self._platform}/{topic}", reports)


class ExchangeTap:
    """One of them."""

    def __init__(
        self, exchange: Exchange, loop: asyncio.AbstractEventLoop, topic: str, reports: Callable[[], None] | None
    ) -> None:
        self.latest: Envelope[Any] | None = None
        self.count = 0
        self._exchange, self._loop, self._topic, self._reports = exchange, loop, topic, reports
        self._unsubscribe: Unsubscribe | None = None
        self._is_closed = False
        loop.call_soon_threadsafe(self._begin)

    def close(self) -> None:
        """Listens no more."""
        self._is_closed = True
        with suppress(RuntimeError):  # the loop has been closed: nothing is published any more
            self._loop.call_soon_threadsafe(self._end)

    def _begin(self) -> None:
        if not self._is_closed:
            self._unsubscribe = self._exchange.subscribe(self._topic, self._receive)

    def _end(self) -> None:
        if self._unsubscribe is not None:
            self._unsubscribe()
            self._unsubscribe = None

    def _receive(self, envelope: Envelope[Any]) -> None:
        self.latest = envelope
        self.count += 1
        if self._reports is not None:
            self._reports()
