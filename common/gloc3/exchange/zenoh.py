"""The zenoh middleware: between processes, hosts, stations and platforms.

What is published here reaches the subscribers of this process by reference, at once. It is encoded and leaves the
process only while somebody elsewhere asks for it. Zenoh's threads hand what comes in over to the loop, many messages
with one wake; subscribers are called in the loop's thread, as on every middleware.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

import zenoh

from gloc3.exchange.base import Deliver, Unsubscribe
from gloc3.exchange.inbound import Arrivals, Inbound
from gloc3.exchange.local import LocalExchange
from gloc3.exchange.sender import Sender
from gloc3.exchange.zenoh_session import Node, open_session, plain
from gloc3.messages import Envelope
from gloc3.topics import Service, TopicTable, matches
from gloc3.wire import WireError

SERVICES: Final[Mapping[Service, tuple[zenoh.Priority, zenoh.CongestionControl, zenoh.Reliability]]] = {
    Service.COMMAND: (
        zenoh.Priority.INTERACTIVE_HIGH,
        zenoh.CongestionControl.BLOCK,
        zenoh.Reliability.RELIABLE,
    ),
    Service.REPORT: (zenoh.Priority.DATA, zenoh.CongestionControl.BLOCK, zenoh.Reliability.RELIABLE),
    Service.CONTROL: (zenoh.Priority.REAL_TIME, zenoh.CongestionControl.DROP, zenoh.Reliability.BEST_EFFORT),
    Service.STREAM: (zenoh.Priority.DATA_HIGH, zenoh.CongestionControl.DROP, zenoh.Reliability.BEST_EFFORT),
    Service.BULK: (zenoh.Priority.DATA_LOW, zenoh.CongestionControl.DROP, zenoh.Reliability.BEST_EFFORT),
}
"""What Zenoh is told for each service. What blocks is sent by a thread of its own."""
SETTLE_S: Final = 1.0
"""After so long a node knows who asks for a topic that it has begun to publish."""
PART: Final = re.compile(r"\*|\?|\[[^]]*\]")
"""What stands for some characters in a level of a pattern."""

Troubled = Callable[[str, str], None]
"""Takes what was counted, such as `damaged`, and a line for people."""


@contextmanager
def open_exchange(
    node: Node, loop: asyncio.AbstractEventLoop, topics: TopicTable, troubled: Troubled = lambda *_: None
) -> Iterator[ZenohExchange]:
    """A node's exchanger for as long as the block lasts; always closed behind it, since otherwise no process ends.

    Raises:
        Gloc3Error: an endpoint is taken or wrong, or a child's parent is not there.
    """
    with open_session(node) as session:
        exchange = ZenohExchange(session, loop, topics, troubled)
        try:
            yield exchange
        finally:
            exchange.close()


class ZenohExchange:
    """A data exchanger over one Zenoh session, which stays the caller's to close.

    Args:
        session: an open session, as `zenoh_session.open_session` gives.
        loop: calls the subscribers.
        topics: the types that may travel.
        troubled: is told, in the loop, of each message that was not taken.
    """

    def __init__(
        self,
        session: zenoh.Session,
        loop: asyncio.AbstractEventLoop,
        topics: TopicTable,
        troubled: Troubled = lambda *_: None,
    ) -> None:
        self.here: Final = LocalExchange()
        """What passes inside this process: what it published, and what came in because somebody here asked for it."""
        self.counts: Final[dict[str, int]] = {}
        """How many messages were not taken or not sent, by the reason in a word."""
        self._session = session
        self._loop = loop
        self._topics = topics
        self._troubled = troubled
        self._outlets: dict[str, _Outlet | None] = {}
        self._sources: dict[str, _Subscription] = {}
        self._tokens: set[zenoh.LivelinessToken] = set()
        self._watches: dict[str, _Watch] = {}
        self._owners: dict[str, _Subscription | None] = {}
        """By topic: through which of several fitting subscriptions its messages are taken, so that each comes once."""
        self._arrivals = Arrivals(loop, self._take)
        self._senders = {
            service: Sender(f"zenoh {service}", self._fail)
            for service, (_, congestion, _) in SERVICES.items()
            if congestion is zenoh.CongestionControl.BLOCK
        }
        self._is_open = True

    # --- the exchange ---

    def publish(self, envelope: Envelope[Any]) -> None:
        """Hands a message to the subscribers here and, while there are some, elsewhere."""
        self.here.publish(envelope)
        try:
            outlet = self._outlets[envelope.topic]
        except KeyError:
            outlet = self._open_outlet(envelope.topic)
        if outlet is None or not outlet.is_wanted or not self._is_open:
            return
        if not outlet.put(self._topics.types.encode(envelope)):
            self._count("unsent", f"{envelope.topic}: too many messages wait for a link")

    def subscribe(self, pattern: str, deliver: Deliver) -> Unsubscribe:
        """Asks for a topic or a pattern of topics, here and elsewhere."""
        subscription = self._sources.get(pattern)
        if subscription is None:
            subscription = self._sources[pattern] = _Subscription(pattern)
            self._owners.clear()
            subscription.declared = self._session.declare_subscriber(
                key_expression(pattern),
                self._arrivals.taker(subscription.inbound),
                allowed_origin=zenoh.Locality.REMOTE,
            )
        subscription.users += 1
        end_here = self.here.subscribe(pattern, deliver)
        is_open = True

        def unsubscribe() -> None:
            nonlocal is_open
            if not is_open:
                return
            is_open = False
            end_here()
            subscription.users -= 1
            if not subscription.users:
                del self._sources[pattern]
                self._owners.clear()
                subscription.declared.undeclare()  # type: ignore[no-untyped-call]

        return unsubscribe

    def declare_alive(self, token: str) -> Unsubscribe:
        """Says here and elsewhere that something is here; it is gone at once when this process is."""
        withdraw_here = self.here.declare_alive(token)
        declared = self._session.liveliness().declare_token(token)
        self._tokens.add(declared)  # one that nobody holds is withdrawn

        def withdraw() -> None:
            if declared in self._tokens:
                self._tokens.remove(declared)
                withdraw_here()
                declared.undeclare()  # type: ignore[no-untyped-call]

        return withdraw

    def watch(self, pattern: str, changed: Callable[[str, bool], None]) -> Unsubscribe:
        """Reports tokens that come and go, here and elsewhere; those of a node that fell silent go after its lease."""
        watch = self._watches.get(pattern)
        if watch is None:
            watch = self._watches[pattern] = _Watch()
            watch.declared = self._session.liveliness().declare_subscriber(
                key_expression(pattern), self._arrivals.taker(watch.inbound), history=True
            )
        watch.users += 1
        end_here = self.here.watch(pattern, changed)
        is_open = True

        def unwatch() -> None:
            nonlocal is_open
            if not is_open:
                return
            is_open = False
            end_here()
            watch.users -= 1
            if not watch.users:
                del self._watches[pattern]
                watch.declared.undeclare()  # type: ignore[no-untyped-call]
                for withdraw in watch.tokens.values():
                    withdraw()

        return unwatch

    def close(self) -> None:
        """Sends and hears nothing from now on."""
        self._is_open = False
        self._arrivals.close()
        for sender in self._senders.values():
            sender.close()

    # --- out ---

    def _open_outlet(self, topic: str) -> _Outlet | None:
        """What sends a topic; none for one whose name cannot travel."""
        row = self._topics.row(topic)
        service = Service.REPORT if row is None else row.travels
        outlet = None
        try:
            outlet = _Outlet(self._session, self._loop, self._arrivals, topic, service, self._senders.get(service))
        except zenoh.ZError as error:
            self._count("unsendable", f"{topic} cannot leave this process: {plain(error)}")
        self._outlets[topic] = outlet
        return outlet

    def _fail(self, error: BaseException) -> None:
        """In a thread: something could not be sent."""
        self._loop.call_soon_threadsafe(self._count, "unsent", f"not sent: {error}")

    # --- in ---

    def _take(self, inbound: Inbound, sample: Any) -> None:
        """In the loop: a sample of a subscription or of a watch, or a change of who wants a topic."""
        source = inbound.source
        if isinstance(source, _Subscription):
            self._take_message(source, sample)
        elif isinstance(source, _Watch):
            self._take_token(source, str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)
        elif isinstance(source, _Outlet) and self._is_open:
            source.look()

    def _take_message(self, source: _Subscription, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        try:
            owner = self._owners[key]
        except KeyError:
            owner = self._owners[key] = next((s for p, s in self._sources.items() if matches(p, key)), None)
        if owner is not source:
            return
        try:
            envelope = self._topics.types.decode(sample.payload.to_bytes())
        except WireError as error:
            self._count("damaged", f"{key}: {error}")
            return
        if envelope.topic != key:
            self._count("misplaced", f"a message of {envelope.topic} came on {key}")
            return
        self.here.publish(envelope)

    def _take_token(self, watch: _Watch, token: str, is_alive: bool) -> None:
        if is_alive and token not in watch.tokens:
            watch.tokens[token] = self.here.declare_alive(token)
        elif not is_alive and token in watch.tokens:
            watch.tokens.pop(token)()

    def _count(self, kind: str, text: str) -> None:
        self.counts[kind] = self.counts.get(kind, 0) + 1
        self._troubled(kind, text)


class _Outlet:
    """Sends one topic while somebody elsewhere asks for it, or while that is not known yet."""

    def __init__(
        self,
        session: zenoh.Session,
        loop: asyncio.AbstractEventLoop,
        arrivals: Arrivals,
        topic: str,
        service: Service,
        sender: Sender | None,
    ) -> None:
        priority, congestion, reliability = SERVICES[service]
        self._publisher = session.declare_publisher(
            topic,
            allowed_destination=zenoh.Locality.REMOTE,
            priority=priority,
            congestion_control=congestion,
            reliability=reliability,
        )
        self._sender = sender
        self.is_wanted = True
        self._is_settled = False
        self._listener = self._publisher.declare_matching_listener(arrivals.taker(Inbound(self)))
        loop.call_later(SETTLE_S, self._settle)

    def put(self, data: bytes) -> bool:
        """Sends a message, or gives it to who does; False where that has too many already."""
        if self._sender is not None:
            return self._sender.give(self._publisher.put, data)
        self._publisher.put(data)
        return True

    def look(self) -> None:
        """In the loop: who asks for it has changed."""
        if self._is_settled:
            status: Any = self._publisher.matching_status  # the stub says bool
            self.is_wanted = status.matching

    def _settle(self) -> None:
        self._is_settled = True
        self.look()


class _Subscription:
    """One pattern that somebody here asks others for."""

    declared: zenoh.Subscriber[None]

    def __init__(self, pattern: str) -> None:
        self.pattern = pattern
        self.inbound = Inbound(self)
        self.users = 0


class _Watch:
    """One pattern of tokens that somebody here watches elsewhere."""

    declared: zenoh.Subscriber[None]

    def __init__(self) -> None:
        self.inbound = Inbound(self)
        self.tokens: dict[str, Unsubscribe] = {}
        self.users = 0


def key_expression(pattern: str) -> zenoh.KeyExpr:
    """A pattern of topics as Zenoh writes it; never narrower: what stands for a part of a level becomes `$*`."""
    levels = [level if level in ("*", "**") else PART.sub("$*", level) for level in pattern.split("/")]
    return zenoh.KeyExpr.autocanonize("/".join(levels))
