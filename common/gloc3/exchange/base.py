"""Interface of the data exchanger's middlewares, the publisher that stamps envelopes, and the local middleware."""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, Protocol

from gloc3.component.workers import guard
from gloc3.messages.envelope import CommandRequest, Envelope, FunctionRequest, Message, Source
from gloc3.messages.topics import TopicTable, matches
from gloc3.messages.wire import type_name

Deliver = Callable[[Envelope[Any]], None]
"""Takes a message in. Called in the loop's thread; it must not block."""

Unsubscribe = Callable[[], None]


class Exchange(Protocol):
    """Publish, subscribe and liveliness. Request and reply are a layer on top: `gloc3.exchange.request`."""

    @property
    def here(self) -> "Exchange":
        """Traffic inside this process: local publications, and remote messages with a local subscriber.

        A recorder subscribes here to receive everything without drawing additional data from other processes.
        """

    def publish(self, envelope: Envelope[Any]) -> None:
        """Sends a message to all subscribers of its topic. Never blocks."""

    def subscribe(self, pattern: str, deliver: Deliver) -> Unsubscribe:
        """Asks for a topic, or for all that fit a pattern: `*` is one level, a final `**` any number of levels."""

    def declare_alive(self, token: str) -> Unsubscribe:
        """Declares that something (a component, a host) is alive, until the returned function is called."""

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


MOST_ROUTES: Final = 10_000
"""Topics whose subscribers are remembered; names of topics may come from others."""


class LocalExchange:
    """Local exchange: inside one process, messages pass by reference.

    It delivers in the order of publishing, to the subscribers in the order of their subscription.

    A subscriber that raises affects neither the publisher nor the other subscribers: the loop's exception handler is
    called.

    Args:
        topics: defines which topics are latched; without it none is.
    """

    def __init__(self, topics: TopicTable | None = None) -> None:
        self._topics = topics
        self._last: dict[str, Envelope[Any]] = {}
        """The last message of each latched topic."""
        self._subscribers: list[tuple[str, Deliver]] = []
        self._routes: dict[str, tuple[Deliver, ...]] = {}
        self._tokens: dict[str, int] = {}
        self._listeners: list[tuple[str, Callable[[str, bool], None]]] = []
        self._waiting: deque[Envelope[Any]] = deque()
        self._is_delivering = False

    @property
    def here(self) -> "LocalExchange":
        """Itself: nothing is elsewhere."""
        return self

    def publish(self, envelope: Envelope[Any]) -> None:
        """Hands a message to every subscriber of its topic, at once.

        What subscribers publish meanwhile follows when all have this one.
        """
        self._waiting.append(envelope)
        if self._is_delivering:
            return
        self._is_delivering = True
        try:
            while self._waiting:
                envelope = self._waiting.popleft()
                route = self._routes.get(envelope.topic)
                self._hand_over(self._new_route(envelope.topic) if route is None else route, envelope)
        finally:
            self._is_delivering = False

    def _new_route(self, topic: str) -> tuple[Deliver, ...]:
        route = tuple(deliver for pattern, deliver in self._subscribers if matches(pattern, topic))
        row = None if self._topics is None else self._topics.row(topic)
        if row is not None and row.is_latched:
            route = (self._keep, *route)
        if len(self._routes) >= MOST_ROUTES:
            self._routes.clear()
        self._routes[topic] = route
        return route

    def _hand_over(self, route: Iterable[Deliver], envelope: Envelope[Any]) -> None:
        rest = iter(route)
        while (error := guard(_hand, rest, envelope)[1]) is not None:  # goes on behind the one that failed
            _report_problem(f"a subscriber of {envelope.topic} failed", error)

    def _keep(self, envelope: Envelope[Any]) -> None:
        self._last[envelope.topic] = envelope

    def last(self, topic: str) -> Envelope[Any] | None:
        """The last message of a latched topic; None where there was none."""
        return self._last.get(topic)

    def subscribe(self, pattern: str, deliver: Deliver) -> Unsubscribe:
        """Asks for a topic or a pattern of topics; of latched ones the last message comes at once."""
        entry = (pattern, deliver)
        self._subscribers.append(entry)
        self._routes.clear()
        for topic, envelope in list(self._last.items()):
            if matches(pattern, topic):
                self._hand_over((deliver,), envelope)

        def unsubscribe() -> None:
            if entry in self._subscribers:
                self._subscribers.remove(entry)
                self._routes.clear()

        return unsubscribe

    def declare_alive(self, token: str) -> Unsubscribe:
        """Declares that something is alive."""
        self._tokens[token] = self._tokens.get(token, 0) + 1
        if self._tokens[token] == 1:
            self._notify_watchers(token, True)
        is_open = True

        def withdraw() -> None:
            nonlocal is_open
            if not is_open:
                return
            is_open = False
            self._tokens[token] -= 1
            if not self._tokens[token]:
                del self._tokens[token]
                self._notify_watchers(token, False)

        return withdraw

    def watch(self, pattern: str, changed: Callable[[str, bool], None]) -> Unsubscribe:
        """Reports tokens that come and go."""
        entry = (pattern, changed)
        self._listeners.append(entry)
        for token in list(self._tokens):
            if matches(pattern, token):
                changed(token, True)

        def unwatch() -> None:
            if entry in self._listeners:
                self._listeners.remove(entry)

        return unwatch

    def _notify_watchers(self, token: str, is_alive: bool) -> None:
        for pattern, changed in list(self._listeners):
            if matches(pattern, token):
                _, error = guard(changed, token, is_alive)
                if error is not None:
                    _report_problem(f"a watcher of {token} failed", error)


def _hand(rest: Iterator[Deliver], envelope: Envelope[Any]) -> None:
    for deliver in rest:
        deliver(envelope)


def _report_problem(message: str, error: BaseException) -> None:
    """Reports a bug in a subscriber; the publisher is not affected."""
    asyncio.get_running_loop().call_exception_handler({"message": message, "exception": error})


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

    def handle(envelope: Envelope[Any]) -> None:
        if envelope.payload.request_id == message.request_id and not answer.done():
            answer.set_result(envelope.payload)

    unsubscribe = exchange.subscribe(f"{topic.rpartition('/')[0]}/{REPLY_TOPICS[type(message)]}", handle)
    try:
        publisher.publish(topic, message, loop.time())
        async with asyncio.timeout(timeout_s):
            return await answer
    finally:
        unsubscribe()
