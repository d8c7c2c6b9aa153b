"""Subscribes to topics of platforms for screens and servers: the shell around `Watches`."""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from functools import cached_property
from typing import Any, Final

import msgspec

from gloc3.exchange.base import Exchange, Unsubscribe
from gloc3.messages.command_interface import ListTopics, Outcome, Watch
from gloc3.messages.envelope import Envelope
from gloc3.messages.topics import TopicTable
from gloc3.messages.watch import WATCH, TopicEntry, Want
from gloc3_groundstation.station.command_client import CommandClient
from gloc3_groundstation.station.watches import Watches

ANSWER_S: Final = 1.9
"""Timeout of a watch request, s: it is repeated soon, so a later answer is neither awaited nor queried."""
LIST_S: Final = 10.0
LIST_AGAIN_S: Final = 5.0

Seen = Callable[[str, Envelope[Any]], None]
"""Called with the platform and the watched message."""


class FleetMonitor:
    """Topic subscriptions of a station; all viewers of a platform share one lease."""

    def __init__(self, exchange: Exchange, loop: asyncio.AbstractEventLoop, client: CommandClient) -> None:
        """Creates a monitor without watched topics.

        Args:
            exchange: reaches the platforms.
            loop: the event loop, for time and timers.
            client: sends requests to the platforms.
        """
        self._exchange = exchange
        self._loop = loop
        self._client = client
        self._seen: list[Seen] = []
        self._unsubscribe: Unsubscribe | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._tasks: set[asyncio.Task[Any]] = set()
        self._listing: dict[str, float] = {}
        """When the list of a platform may be requested again."""

    @cached_property
    def watches(self) -> Watches:
        """Watched topics, and the received data."""
        return Watches(TopicTable.installed().types)

    def watch(
        self,
        viewer: str,
        platform: str,
        wants: Sequence[Want],
        *,
        is_listing: bool = False,
        for_s: float = float("inf"),
    ) -> None:
        """See `Watches.watch`."""
        self.watches.watch(viewer, platform, wants, self._loop.time(), is_listing=is_listing, for_s=for_s)
        self._run()

    def unwatch(self, viewer: str, except_from: str = "") -> None:
        """See `Watches.unwatch`."""
        self.watches.unwatch(viewer, except_from)
        self._run()

    def list_topics(self, platform: str) -> None:
        """Requests the topics of a platform, unless they are known or have just been requested."""
        now_s = self._loop.time()
        if not self.watches.entries(platform) and now_s >= self._listing.get(platform, 0.0):
            self._listing[platform] = now_s + LIST_AGAIN_S
            self._start(self._list(platform))

    def listen(self, seen: Seen) -> Unsubscribe:
        """Registers a listener for all watched messages."""
        self._seen.append(seen)
        return lambda: self._seen.remove(seen) if seen in self._seen else None

    def close(self) -> None:
        """Stops requesting and receiving; requests expire with their lease."""
        if self._timer is not None:
            self._timer.cancel()
        if self._unsubscribe is not None:
            self._unsubscribe()
        for task in list(self._tasks):
            task.cancel()

    def _run(self) -> None:
        """Sends the requests that are due, and sets the timer."""
        if self._unsubscribe is None:
            self._unsubscribe = self._exchange.subscribe(f"*/{WATCH}**", self._receive)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        now_s = self._loop.time()
        for platform, wanted in self.watches.due(now_s):
            self._start(self._request(platform, wanted))
        for platform in self.watches.lists_due():
            self.list_topics(platform)
        next_s = self.watches.next_s()
        if next_s is not None:
            self._timer = self._loop.call_at(max(next_s, now_s + 1e-3), self._run)

    def _receive(self, envelope: Envelope[Any]) -> None:
        message = self.watches.receive(envelope, self._loop.time())
        if message is not None:
            platform = envelope.topic.partition("/")[0]
            for seen in tuple(self._seen):
                seen(platform, message)

    async def _request(self, platform: str, wanted: Watch) -> None:
        reply = await self._client.request(platform, wanted, ANSWER_S)
        if reply.outcome is Outcome.ACCEPTED:
            self.watches.answered(platform, reply.result.get("refused", {}))
        elif reply.outcome is Outcome.REFUSED:
            self.watches.answered(platform, {}, reply.reason)

    async def _list(self, platform: str) -> None:
        reply = await self._client.request(platform, ListTopics(), LIST_S)
        if reply.outcome is Outcome.ACCEPTED:
            entries = msgspec.convert(reply.result.get("topics", []), list[TopicEntry])
            self.watches.listed(platform, entries)

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
