"""What every middleware of the data exchanger offers, and the publisher that stamps envelopes."""

import asyncio
from collections.abc import Callable
from typing import Any, Protocol

from gloc3.messages.envelope import CommandRequest, Envelope, FunctionRequest, Message, Source
from gloc3.messages.wire import type_name

Deliver = Callable[[Envelope[Any]], None]
"""Takes a message in. Called in the loop's thread; it must not block."""

Unsubscribe = Callable[[], None]


class Exchange(Protocol):
    """Publish, subscribe and liveliness. Request and reply are a layer on top: `gloc3.exchange.request`."""

    @property
    def here(self) -> "Exchange":
        """What passes inside this process: what it publishes, and what came in because somebody here asked for it.

        Who wants to see everything, such as a recorder, listens here, and so draws nothing from elsewhere.
        """

    def publish(self, envelope: Envelope[Any]) -> None:
        """Sends a message to everyone who subscribed to its topic. Never blocks."""

    def subscribe(self, pattern: str, deliver: Deliver) -> Unsubscribe:
        """Asks for a topic, or for all that fit a pattern: `*` is one level, a final `**` any number of levels."""

    def declare_alive(self, token: str) -> Unsubscribe:
        """Says that something (a component, a host) is here; it is gone when the returned function is called."""

    def watch(self, pattern: str, changed: Callable[[str, bool], None]) -> Unsubscribe:
        """Reports tokens that come (True) and go (False), those that are here already at once."""


class Publisher:
    """Publishes for one source: counts sequences and stamps envelopes."""

    def __init__(self, exchange: Exchange, platform: str, component: str, boot: int) -> None:
        self._exchange = exchange
        self._platform = platform
        self._component = component
        self._sequences: dict[str, int] = {}
        self.source = Source(platform, component, boot)

    def restart(self, boot: int) -> None:
        """Begins another life of the source: a new boot number, sequences from 0."""
        self.source = Source(self._platform, self._component, boot)
        self._sequences.clear()

    def publish(self, topic: str, message: Message, t_s: float, frame: str = "") -> None:
        """Sends a message on a topic (the platform's name included)."""
        sequence = self._sequences.get(topic, 0)
        self._sequences[topic] = sequence + 1
        self._exchange.publish(Envelope(topic, self.source, sequence, t_s, frame, type_name(type(message)), message))


REPLY_TOPICS = {CommandRequest: "reply", FunctionRequest: "function_reply"}


async def request(
    exchange: Exchange, publisher: Publisher, topic: str, message: CommandRequest | FunctionRequest, timeout_s: float
) -> Any:
    """Publishes a request on `PLATFORM/components/NAME/{command,function}` and waits for the reply.

    Raises:
        TimeoutError: no reply came within `timeout_s`. Whether the request was carried out is then *unknown*.
    """
    loop = asyncio.get_running_loop()
    answer: asyncio.Future[Message] = loop.create_future()

    def take(envelope: Envelope[Any]) -> None:
        if envelope.payload.request_id == message.request_id and not answer.done():
            answer.set_result(envelope.payload)

    unsubscribe = exchange.subscribe(f"{topic.rpartition('/')[0]}/{REPLY_TOPICS[type(message)]}", take)
    try:
        publisher.publish(topic, message, loop.time())
        async with asyncio.timeout(timeout_s):
            return await answer
    finally:
        unsubscribe()
