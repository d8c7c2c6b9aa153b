"""One key on which this process sends over Zenoh, by the service that a topic's row asks for."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import zenoh

from gloc3.exchange.inbound import Arrivals, Inbound
from gloc3.exchange.near import NearServer
from gloc3.exchange.sender import Sender
from gloc3.messages.topics import Service
from gloc3.messages.wire import TypeRegistry

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
SETTLE_S: Final = 1.0
"""After so long a node knows who asks for a key on which it has begun to publish."""


class Means(NamedTuple):
    """What all that one exchanger sends with shares."""

    session: zenoh.Session
    loop: asyncio.AbstractEventLoop
    arrivals: Arrivals
    types: TypeRegistry
    near: NearServer | None
    """For large messages to processes on this computer."""
    sender: Sender
    """Sends what is huge."""


class Channel:
    """Sends on one key, and knows whether somebody elsewhere asks for it.

    Args:
        means: of the exchanger.
        key: where it sends.
        service: how that travels.
    """

    def __init__(self, means: Means, key: str, service: Service) -> None:
        priority, reliability = SERVICES[service]
        self._key, self._priority = key, priority
        self._session, self._sender = means.session, means.sender
        self._publisher = means.session.declare_publisher(
            key,
            allowed_destination=zenoh.Locality.REMOTE,
            priority=priority,
            congestion_control=zenoh.CongestionControl.DROP,
            express=service is Service.BULK,  # what is large fills packets of its own
            reliability=reliability,
        )
        self._listener = self._publisher.declare_matching_listener(means.arrivals.taker(Inbound(self._look)))
        self.is_settled = False
        """Whether it is known by now who asks for it; those who have just begun to ask may not be known yet."""
        self._is_wanted = False
        self._is_open = True
        self._timer = means.loop.call_later(SETTLE_S, self._settle)

    @property
    def is_wanted(self) -> bool:
        """Whether somebody elsewhere asks for it, or may."""
        return self._is_wanted or not self.is_settled

    def put(self, body: bytes, head: bytes | None) -> str:
        """Sends a message; returns why it was dropped here, or an empty text."""
        if len(body) < HUGE:
            self._publisher.put(body, attachment=head)
            return ""

        def wait_and_put() -> None:
            self._session.put(
                self._key,
                body,
                attachment=head,
                allowed_destination=zenoh.Locality.REMOTE,
                priority=self._priority,
                congestion_control=zenoh.CongestionControl.BLOCK,
            )

        return "" if self._sender.give(wait_and_put) else "others still wait for a link"

    def close(self) -> None:
        """Looks no more."""
        self._is_open = False
        self._timer.cancel()

    def _look(self, _: object = None) -> None:
        """In the loop: who asks for it has changed."""
        if self._is_open:
            status: Any = self._publisher.matching_status  # the stub says bool
            self._is_wanted = status.matching

    def _settle(self) -> None:
        self.is_settled = True
        self._look()
