"""Large messages: through shared memory to receivers on this computer, else through Zenoh.

A sender declares a key of its own below the topic, `TOPIC/bulk/NAME`. A liveliness token on it announces the sender, a
query returns the ticket to its memory, and messages to receivers without that memory are put there. The access rules of
the topic apply to that key, too: a ticket requires read access.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from typing import Final

import zenoh

from gloc3.exchange.channel import Means, TopicChannel
from gloc3.exchange.inbound import Inbound
from gloc3.exchange.near import DEPTH, LONGEST_HEAD, NearLink, NearServer
from gloc3.messages.topics import TopicService

LARGE: Final = 16_384
"""Size from which messages are sent as large ones, bytes."""
BULK: Final = "bulk"
"""Level of the key, after the topic."""
KEY: Final = re.compile(rf"(.+)/{BULK}/[0-9a-f]{{16}}")
TICKET_S: Final = 2.0
"""How long the ticket may take; after that the messages come through Zenoh."""
AGAIN_S: Final = 0.5
"""Delay after which a disconnected reader requests the ticket again, s."""

Receive = Callable[[str, bytes | None, bytes], None]
"""Takes the topic, the head and the body of a message, in the loop."""
ReportProblem = Callable[[str, str, str], None]
"""Called with a problem: a keyword, the topic, a reason."""


def bulk_key(pattern: str, name: str = "*") -> str:
    """Key of a topic's large messages from one sender; by default the pattern for all senders."""
    return f"{pattern}/{BULK}/{name}"


def topic_of(key: str) -> str:
    """The topic of a key, which may be that of its large messages."""
    match = KEY.fullmatch(key) if f"/{BULK}/" in key else None
    return match[1] if match is not None else key


class LargeOutlet:
    """Sends the large messages of one topic to their receivers.

    Args:
        means: shared means of the exchange.
        near: serves processes on this computer.
        topic: the topic.
    """

    def __init__(self, means: Means, near: NearServer, topic: str) -> None:
        self._key = bulk_key(topic, near.name)
        self._near = near.open()
        self._channel = TopicChannel(means, self._key, TopicService.BULK)
        self._held = (
            means.session.declare_queryable(self._key, self._answer, allowed_origin=zenoh.Locality.REMOTE),
            means.session.liveliness().declare_token(self._key),
        )

    @property
    def is_settled(self) -> bool:
        """Whether the topic's subscribers have had time to subscribe to its large messages, too."""
        return self._channel.is_settled

    def send(self, head: bytes | None, body: bytes) -> str:
        """Sends a message; returns why a receiver did not get it, or an empty text."""
        reason = ""
        if len(head or b"") <= LONGEST_HEAD:
            try:
                reason = self._near.send(head or b"", body)
            except OSError as error:
                reason = f"no memory to share: {error.strerror}"
        if self._channel.is_settled and self._channel.is_wanted:
            reason = self._channel.put(body, head) or reason
        return reason

    def close(self) -> None:
        """Looks no more."""
        self._channel.close()

    def _answer(self, query: zenoh.Query) -> None:
        """Handles a query for the ticket, in a thread of Zenoh."""
        with query:
            query.reply(self._key, self._near.ticket)


class LargeInlet:
    """Receives large messages from all senders, each through shared memory or Zenoh.

    Args:
        means: shared means of the exchange.
        handle: called with each message.
        problem: called when memory cannot be used.
    """

    def __init__(self, means: Means, handle: Receive, problem: ReportProblem) -> None:
        self.means, self.take, self.report_problem = means, handle, problem
        self._sources: dict[str, LargeSource] = {}
        self._late: dict[str, int] = {}
        """Dropped messages of sources that are closed, by topic."""

    def set_alive(self, key: str, is_alive: bool) -> None:
        """Adds or removes a sender of large messages of a subscribed topic."""
        if not is_alive:
            source = self._sources.pop(key, None)
            if source is not None:
                source.close()
                self._late[source.topic] = self._late.get(source.topic, 0) + source.late
        elif key not in self._sources:
            self._sources[key] = LargeSource(self, key)

    def drop_unwanted(self, is_wanted: Callable[[str], bool]) -> None:
        """Closes the sources of topics without a local subscriber."""
        for key in [key for key, source in self._sources.items() if not is_wanted(source.topic)]:
            self.set_alive(key, False)

    def late(self) -> dict[str, int]:
        """By topic, how many messages came while the loop was busy and were dropped."""
        found = dict(self._late)
        for source in self._sources.values():
            found[source.topic] = found.get(source.topic, 0) + source.late
        return {topic: number for topic, number in found.items() if number}

    def close(self) -> None:
        """Reads nothing any more."""
        self.drop_unwanted(lambda _: False)


class LargeSource:
    """Reads the large messages that another has of one topic."""

    def __init__(self, inlet: LargeInlet, key: str) -> None:
        self.topic = topic_of(key)
        self._inlet, self._key = inlet, key
        self._session, self._loop = inlet.means.session, inlet.means.loop
        self._inbound = Inbound(self._receive, DEPTH)
        self._arrived = inlet.means.arrivals.receiver(self._inbound)
        self._near: NearLink | None = None
        self._late = 0
        self._through_zenoh: zenoh.Subscriber[None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._begin()

    @property
    def late(self) -> int:
        """How many came while the loop was busy, and were dropped."""
        return self._late + self._inbound.dropped + (self._near.late if self._near is not None else 0)

    def _receive(self, thing: zenoh.Reply | zenoh.Sample) -> None:
        """In the loop: the answer with the ticket, or a message that came through Zenoh."""
        if isinstance(thing, zenoh.Sample):
            if self._through_zenoh is not None:
                head = thing.attachment
                self._inlet.take(self.topic, None if head is None else head.to_bytes(), thing.payload.to_bytes())
        elif self._near is not None and self._timer is not None and thing.ok is not None:
            self._stop_timer()
            self._near.show(thing.ok.payload.to_bytes())

    def close(self) -> None:
        """Reads nothing any more."""
        self._stop_timer()
        self._leave()
        if self._through_zenoh is not None:
            self._through_zenoh.undeclare()  # type: ignore[no-untyped-call]
            self._through_zenoh = None

    def _begin(self) -> None:
        self._timer = None
        if self._inlet.means.near is None:
            self._go_through_zenoh()
            return
        name = self._key.rpartition("/")[2]
        try:
            self._near = NearLink(self._loop, name, self._receive_near, self._cut_off)
        except OSError:  # it is on another computer, or of another user
            self._go_through_zenoh()
            return
        self._timer = self._loop.call_later(TICKET_S, self._go_through_zenoh)
        self._session.get(
            self._key,
            self._arrived,
            allowed_destination=zenoh.Locality.REMOTE,
            timeout=TICKET_S,
        )

    def _receive_near(self, head: bytes, body: bytes) -> None:
        self._inlet.take(self.topic, head or None, body)

    def _cut_off(self, reason: str) -> None:
        """The other has ended it: it does so with those that are stuck, and when it ends itself."""
        self._leave()
        self._stop_timer()
        if reason:
            self._inlet.report_problem("damaged", self.topic, reason)
            self._go_through_zenoh()
        else:
            self._timer = self._loop.call_later(AGAIN_S, self._begin)

    def _go_through_zenoh(self) -> None:
        self._timer = None
        self._leave()
        self._through_zenoh = self._session.declare_subscriber(
            self._key, self._arrived, allowed_origin=zenoh.Locality.REMOTE
        )

    def _leave(self) -> None:
        if self._near is not None:
            self._late += self._near.late
            self._near.close()
            self._near = None

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
