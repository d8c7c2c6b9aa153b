"""Sender on one Zenoh key, with the quality of service of the topic's row."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from threading import Condition, Thread
from typing import Any, Final, NamedTuple

import zenoh

from gloc3.component.workers import guard
from gloc3.exchange.inbound import Arrivals, Inbound
from gloc3.exchange.near import NearServer
from gloc3.messages.topics import TopicService
from gloc3.messages.wire import TypeRegistry

LEAVE_S: Final = 1.0
"""Longest time at shutdown for sending queued messages, s."""

Send = Callable[[], None]


class SendQueue:
    """Sends messages one after the other, in the order in which they were queued.

    Args:
        name: name of the thread.
        depth: limit of queued messages.
        failed: called in the thread with the error of a message that could not be sent.
    """

    def __init__(self, name: str, depth: int, failed: Callable[[BaseException], None]) -> None:
        self._depth = depth
        self._failed = failed
        self._waiting: deque[Send] = deque()
        self._changed = Condition()
        self._is_idle = False
        self._is_open = True
        self._thread = Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def give(self, send: Send) -> bool:
        """Takes a message over, unless the queue is full; never waits."""
        if len(self._waiting) >= self._depth:
            return False
        self._waiting.append(send)
        if self._is_idle:
            with self._changed:
                self._changed.notify()
        return True

    def close(self) -> None:
        """Ends when everything has been sent, or after a while without that."""
        with self._changed:
            self._is_open = False
            self._changed.notify()
        self._thread.join(LEAVE_S)

    def _run(self) -> None:
        while True:
            try:
                send = self._waiting.popleft()
            except IndexError:
                if not self._remainder():
                    return
                continue
            _, error = guard(send)
            if error is not None:
                self._failed(error)

    def _remainder(self) -> bool:
        """Waits for a message; False when none will come any more."""
        with self._changed:
            self._is_idle = True  # before the look: who gives one after it will notify
            while not self._waiting:
                if not self._is_open:
                    return False
                self._changed.wait()
            self._is_idle = False
            return True


SERVICES: Final[Mapping[TopicService, tuple[zenoh.Priority, zenoh.Reliability]]] = {
    TopicService.CONTROL: (zenoh.Priority.REAL_TIME, zenoh.Reliability.BEST_EFFORT),
    TopicService.COMMAND: (zenoh.Priority.INTERACTIVE_HIGH, zenoh.Reliability.RELIABLE),
    TopicService.STREAM: (zenoh.Priority.DATA_HIGH, zenoh.Reliability.BEST_EFFORT),
    TopicService.REPORT: (zenoh.Priority.DATA, zenoh.Reliability.RELIABLE),
    TopicService.BULK: (zenoh.Priority.DATA_LOW, zenoh.Reliability.BEST_EFFORT),
}
"""Zenoh priority and reliability of each service. The loop never blocks: what does not fit a link's queue is dropped.
The queue of each priority is so long that reliable messages are lost only if a receiver stands still."""
HUGE: Final = 500_000
"""Size from which a message may not fit the queue of a link, bytes: a thread sends it, blocking."""
SETTLE_S: Final = 1.0
"""Time after which a node knows the subscribers of a key on which it has begun to publish, s."""


class Means(NamedTuple):
    """What all that one exchanger sends with shares."""

    session: zenoh.Session
    loop: asyncio.AbstractEventLoop
    arrivals: Arrivals
    types: TypeRegistry
    near: NearServer | None
    """For large messages to processes on this computer."""
    sender: SendQueue
    """Sends messages of `HUGE` bytes and more."""


class TopicChannel:
    """Sends on one key, and tracks whether a remote subscriber exists.

    Args:
        means: shared means of the exchange.
        key: the key.
        service: its quality of service.
    """

    def __init__(self, means: Means, key: str, service: TopicService) -> None:
        priority, reliability = SERVICES[service]
        self._key, self._priority, self._most_bytes = key, priority, service.most_bytes
        self._session, self._sender = means.session, means.sender
        self._publisher = means.session.declare_publisher(
            key,
            allowed_destination=zenoh.Locality.REMOTE,
            priority=priority,
            congestion_control=zenoh.CongestionControl.DROP,
            express=service is TopicService.BULK,  # what is large fills packets of its own
            reliability=reliability,
        )
        self._listener = self._publisher.declare_matching_listener(
            means.arrivals.receiver(Inbound(self._matching_changed))
        )
        self.is_settled = False
        """Whether the subscribers are known by now; very recent ones may still be missing."""
        self._is_wanted = False
        self._is_open = True
        self._timer = means.loop.call_later(SETTLE_S, self._settle)

    @property
    def is_wanted(self) -> bool:
        """Whether a remote subscriber exists or may exist."""
        return self._is_wanted or not self.is_settled

    def put(self, body: bytes, head: bytes | None) -> str:
        """Sends a message; returns why it was dropped here, or an empty text."""
        if len(body) > self._most_bytes:
            return f"{len(body):,} bytes are more than the {self._most_bytes:,} that such a topic carries"
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

    def _matching_changed(self, _: object = None) -> None:
        """Handles a change of the subscribers, in the loop."""
        if self._is_open:
            status: Any = self._publisher.matching_status  # the stub says bool
            self._is_wanted = status.matching

    def _settle(self) -> None:
        self.is_settled = True
        self._matching_changed()
