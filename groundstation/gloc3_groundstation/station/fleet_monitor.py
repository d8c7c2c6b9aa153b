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
"""What is asked is asked again soon: an answer that takes longer is not waited for, nor asked about."""
LIST_S: Final = 10.0
LIST_AGAIN_S: Final = 5.0

Seen = Callable[[str, Envelope[Any]], None]
"""Is told the platform and the message that was looked at."""


class FleetMonitor:
    """Topic subscriptions of a station; all viewers of a platform share one lease."""

    def __init__(self, exchange: Exchange, loop: asyncio.AbstractEventLoop, client: CommandClient) -> None:
        """A watcher that looks at nothing.

        Args:
            exchange: reaches the platforms.
            loop: gives the time and wakes it.
            client: asks the platforms.
        """
        self._exchange = exchange
        self._loop = loop
        self._client = client
        self._seen: list[Seen] = []
        self._unsubscribe: Unsubscribe | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._tasks: set[asyncio.Task[Any]] = set()
        self._listing: dict[str, float] = {}
        """When the list of a platform may be asked for again."""

    @cached_property
    def watches(self) -> Watches:
        """What is looked at, and what came."""
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
        """Asks a platform for its topics, unless they are known or have just been asked for."""
        now_s = self._loop.time()
        if not self.watches.entries(platform) and now_s >= self._listing.get(platform, 0.0):
            self._listing[platform] = now_s + LIST_AGAIN_S
            self._start(self._list(platform))

    def listen(self, seen: Seen) -> Unsubscribe:
        """Is told everything that is seen."""
        self._seen.append(seen)
        return lambda: self._seen.remove(seen) if seen in self._seen else None

    def close(self) -> None:
        """Asks and hears nothing more; what was asked for ends with its lease."""
        if self._timer is not None:
            self._timer.cancel()
        if self._unsubscribe is not None:
            self._unsubscribe()
        for task in list(self._tasks):
            task.cancel()

    def _run(self) -> None:
        """Asks for what is due, and sets the alarm."""
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
