"""Sends one topic over Zenoh, by the service that its row asks for."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from functools import partial
from typing import Any, Final, NamedTuple

import zenoh

from gloc3.exchange.inbound import Arrivals, Inbound
from gloc3.exchange.sender import Sender
from gloc3.exchange.shared_memory import LARGE, SharedMemory
from gloc3.messages import Envelope, Message
from gloc3.topics import Service, TopicRow
from gloc3.wire import TypeRegistry

LATCHED: Final = "latched"
"""The level of a token's name that stands behind the platform's."""
SETTLE_S: Final = 1.0
"""After so long a node knows who asks for a topic that it has begun to publish."""


SERVICES: Final[Mapping[Service, tuple[zenoh.Priority, zenoh.Reliability]]] = {
    Service.CONTROL: (zenoh.Priority.REAL_TIME, zenoh.Reliability.BEST_EFFORT),
    Service.COMMAND: (zenoh.Priority.INTERACTIVE_HIGH, zenoh.Reliability.RELIABLE),
    Service.STREAM: (zenoh.Priority.DATA_HIGH, zenoh.Reliability.BEST_EFFORT),
    Service.REPORT: (zenoh.Priority.DATA, zenoh.Reliability.RELIABLE),
    Service.BULK: (zenoh.Priority.DATA_LOW, zenoh.Reliability.BEST_EFFORT),
}
"""What Zenoh is told for each service. Nothing ever waits in the loop: what does not fit a link's queue is dropped, and
the queue of each priority holds so much that only a receiver that stands still loses what is reliable."""
HUGE: Final = 500_000
"""Messages of so many bytes might not fit the queue of a link: a thread sends them, and waits for it."""
UNKNOWN: Final = TopicRow(Message, service=Service.REPORT)
"""For topics that nobody has declared."""


class Means(NamedTuple):
    """What the outlets of one exchanger share."""

    session: zenoh.Session
    loop: asyncio.AbstractEventLoop
    arrivals: Arrivals
    types: TypeRegistry
    memory: SharedMemory | None
    sender: Sender
    """Sends what is huge."""


class Outlet:
    """Sends one topic while somebody elsewhere asks for it, or while that is not known yet."""

    def __init__(self, means: Means, topic: str, row: TopicRow) -> None:
        priority, reliability = SERVICES[row.travels]
        self._topic = topic
        self._priority = priority
        self._types, self._memory, self._sender = means.types, means.memory, means.sender
        self._session = means.session
        self._publisher = means.session.declare_publisher(
            topic,
            allowed_destination=zenoh.Locality.REMOTE,
            priority=priority,
            congestion_control=zenoh.CongestionControl.DROP,
            express=row.travels is Service.BULK,  # what is large fills packets of its own
            reliability=reliability,
        )
        self.is_wanted = True
        self._is_settled = False
        self._timer = means.loop.call_later(SETTLE_S, self._settle)
        self._listener = self._publisher.declare_matching_listener(means.arrivals.taker(Inbound(self)))
        self.last: Envelope[Any] | None = None
        """Of a latched topic, the last message."""
        self._held: tuple[Any, ...] = ()
        if row.is_latched:
            self._held = (
                means.session.declare_queryable(topic, self._answer, allowed_origin=zenoh.Locality.REMOTE),
                means.session.liveliness().declare_token(latched_token(topic)),
            )

    def send(self, envelope: Envelope[Any]) -> str:
        """Sends a message, or gives it to who does; returns why it was dropped here, or an empty text."""
        if self._held:
            self.last = envelope
        if not self.is_wanted:
            return ""
        apart = self._types.encode_apart(envelope)
        head, body = (None, self._types.encode(envelope)) if apart is None else apart
        payload: Any = body
        if len(body) >= LARGE and self._memory is not None:
            payload = self._memory.hold(body)
            if payload is None:
                return "receivers hold all of the shared memory"
        if len(body) < HUGE:
            self._publisher.put(payload, attachment=head)
            return ""
        return "" if self._sender.give(partial(self._wait_and_put, payload, head)) else "others still wait for a link"

    def _wait_and_put(self, payload: Any, head: bytes | None) -> None:
        """In the sender's thread."""
        self._session.put(
            self._topic,
            payload,
            attachment=head,
            allowed_destination=zenoh.Locality.REMOTE,
            priority=self._priority,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    def look(self) -> None:
        """In the loop: who asks for it has changed."""
        if self._is_settled:
            status: Any = self._publisher.matching_status  # the stub says bool
            self.is_wanted = status.matching

    def close(self) -> None:
        """Looks no more."""
        self._timer.cancel()

    def _settle(self) -> None:
        self._is_settled = True
        self.look()

    def _answer(self, query: zenoh.Query) -> None:
        """In a thread of Zenoh: somebody came late and asks for the last message."""
        with query:
            if self.last is not None:
                query.reply(self._topic, self._types.encode(self.last))


def latched_token(topic: str) -> str:
    """The token by which others see that a latched topic has a last message; of a pattern, the pattern of tokens."""
    platform, _, name = topic.partition("/")
    return f"*/{LATCHED}/**" if platform == "**" else f"{platform}/{LATCHED}/{name}"
