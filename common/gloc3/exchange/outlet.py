"""Sends one topic over Zenoh, by the service that its row asks for."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
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


class Handling(NamedTuple):
    """What Zenoh is told for a service."""

    priority: zenoh.Priority
    congestion: zenoh.CongestionControl
    reliability: zenoh.Reliability

    @property
    def may_wait(self) -> bool:
        """Whether a message waits for a link that is full, so that a thread has to send it."""
        return self.congestion is zenoh.CongestionControl.BLOCK


WAITS: Final = (zenoh.CongestionControl.BLOCK, zenoh.Reliability.RELIABLE)
DROPS: Final = (zenoh.CongestionControl.DROP, zenoh.Reliability.BEST_EFFORT)
SERVICES: Final[Mapping[Service, Handling]] = {
    Service.CONTROL: Handling(zenoh.Priority.REAL_TIME, *DROPS),
    Service.COMMAND: Handling(zenoh.Priority.INTERACTIVE_HIGH, *WAITS),
    Service.STREAM: Handling(zenoh.Priority.DATA_HIGH, *DROPS),
    Service.REPORT: Handling(zenoh.Priority.DATA, *WAITS),
    Service.BULK: Handling(zenoh.Priority.DATA_LOW, *DROPS),
}
UNKNOWN: Final = TopicRow(Message, service=Service.REPORT)
"""For topics that nobody has declared."""


class Means(NamedTuple):
    """What the outlets of one exchanger share."""

    session: zenoh.Session
    loop: asyncio.AbstractEventLoop
    arrivals: Arrivals
    types: TypeRegistry
    memory: SharedMemory
    senders: Mapping[Service, Sender]
    """Of the services whose messages may have to wait."""


class Outlet:
    """Sends one topic while somebody elsewhere asks for it, or while that is not known yet."""

    def __init__(self, means: Means, topic: str, row: TopicRow) -> None:
        handling = SERVICES[row.travels]
        self._topic = topic
        self._types, self._memory = means.types, means.memory
        self._sender = means.senders.get(row.travels)
        self._publisher = means.session.declare_publisher(
            topic,
            allowed_destination=zenoh.Locality.REMOTE,
            priority=handling.priority,
            congestion_control=handling.congestion,
            reliability=handling.reliability,
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
        """Sends a message, or gives it to who does; returns why it was dropped, or an empty text."""
        if self._held:
            self.last = envelope
        if not self.is_wanted:
            return ""
        apart = self._types.encode_apart(envelope)
        head, body = (None, self._types.encode(envelope)) if apart is None else apart
        if len(body) < LARGE:
            return self._put(body, None)
        shared = self._memory.hold(body)
        if shared is None and self._sender is None:
            return "receivers hold all of the shared memory"
        return self._put(body if shared is None else shared, head)

    def _put(self, payload: bytes | zenoh.shm.ZShmMut, attachment: bytes | None) -> str:
        if self._sender is None:
            self._publisher.put(payload, attachment=attachment)
            return ""
        is_taken = self._sender.give(self._publisher.put, payload, attachment)
        return "" if is_taken else "too many messages wait for a link"

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
