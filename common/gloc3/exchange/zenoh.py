"""Zenoh exchange: between processes, hosts, stations and platforms.

Publications reach the subscribers of this process by reference, at once. They are encoded and leave the process only
while there is a remote subscriber. Zenoh's threads hand received messages over to the loop, many messages with one
wake-up; subscribers are called in the loop's thread, as on every middleware.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, Final

import zenoh

from gloc3.cli.counting import counted
from gloc3.exchange.base import Deliver, LocalExchange, Unsubscribe
from gloc3.exchange.channel import Means, SendQueue
from gloc3.exchange.inbound import Arrivals, Inbound, KeyLimit
from gloc3.exchange.large import LARGE, LargeInlet, bulk_key, topic_of
from gloc3.exchange.near import NearServer
from gloc3.exchange.outlet import LATCHED, UNKNOWN, TopicOutlet, latched_token
from gloc3.exchange.zenoh_session import NodeSession, ZenohEndpoints, open_node, plain
from gloc3.messages.envelope import Envelope, Source
from gloc3.messages.topics import TopicService, TopicTable, matches
from gloc3.messages.wire import VersionsDiffer, WireError

DEPTHS: Final = {TopicService.CONTROL: 64, TopicService.STREAM: 1024, TopicService.BULK: 8}
"""So many messages of one subscription wait for a loop that is busy."""
RELIABLE_DEPTH: Final = 16_384
"""Queue depth for reliable topics, and for patterns that match many topics."""
HUGE_DEPTH: Final = 4
"""So many huge messages wait for links."""
ANSWER_S: Final = 5.0
"""How long the last message of a latched topic may take."""
COUNTED_PLACES: Final = 200
BREAK_S: Final = 3.0
"""Losses within this time are one report: a break of a link costs every topic some messages."""
CALM_S: Final = 60.0
"""Refused connections of an address that come so long after others are counted and reported from the beginning."""
PART: Final = re.compile(r"\*|\?|\[[^]]*\]")
"""A wildcard for some characters in a level of a pattern."""

Troubled = Callable[[str, str], None]
"""Called with a keyword for the event, such as `damaged`, and a line of text for users."""


@contextmanager
def open_exchange(
    node: ZenohEndpoints,
    loop: asyncio.AbstractEventLoop,
    topics: TopicTable,
    troubled: Troubled = lambda *_: None,
    settings: Mapping[str, Any] | None = None,
    *,
    is_sharing: bool = True,
) -> Iterator[ZenohExchange]:
    """Opens a node's exchange for the duration of the block; always closes it, since otherwise the process never ends.

    Args:
        node: its listen and connect endpoints.
        loop: calls the subscribers.
        topics: the message types that may be exchanged.
        troubled: as for `ZenohExchange`.
        settings: additional Zenoh settings by path, such as those of a network file.
        is_sharing: as for `ZenohExchange`.

    Raises:
        Gloc3Error: an endpoint is in use or invalid, or a child's parent is not reachable.
    """
    exchange = ZenohExchange(open_node(node, settings), loop, topics, troubled, is_sharing=is_sharing)
    try:
        yield exchange
    finally:
        exchange.close()


class ZenohExchange:
    """A data exchange over one Zenoh session; `open_exchange` creates one that is always closed.

    Args:
        node: an open session, closed with this.
        loop: calls the subscribers.
        topics: the message types that may be exchanged.
        troubled: called in the loop about lost and refused messages: the first, the tenth, the hundredth…
        is_sharing: whether large messages go to and from processes on this computer through shared memory.
    """

    def __init__(
        self,
        node: NodeSession,
        loop: asyncio.AbstractEventLoop,
        topics: TopicTable,
        troubled: Troubled = lambda *_: None,
        *,
        is_sharing: bool = True,
    ) -> None:
        self.here: Final = LocalExchange(topics)
        """Traffic inside this process: local publications, and remote messages with a local subscriber."""
        self._counts: dict[str, int] = {}
        self._node = node
        self._loop = loop
        self._topics = topics
        self.troubled = troubled
        """Called about lost and refused messages and connections; may be replaced."""
        self._outlets: dict[str, TopicOutlet | None] = {}
        self._sources: dict[str, _Subscription] = {}
        self._tokens: dict[object, tuple[str, zenoh.LivelinessToken | None]] = {}
        self._watches: dict[str, _Watch] = {}
        self._owners: dict[str, _Subscription | None] = {}
        """By topic: through which of several fitting subscriptions its messages are taken, so that each comes once."""
        self._arrivals = Arrivals(loop)
        self._sequences: dict[tuple[str, Source], int] = {}
        """Last sequence number of each topic and source, for counting losses."""
        self._left: set[str] = set()
        """Latched topics that no connected node holds: their next message comes from another life, or is known already."""
        sender = SendQueue("zenoh huge", HUGE_DEPTH, self._fail)
        near = NearServer(loop) if is_sharing else None
        self._means = Means(node.session, loop, self._arrivals, topics.types, near, sender)
        self._large = LargeInlet(self._means, self._receive_bytes, self._count)
        self._refused_s: dict[str, float] = {}  # when last, by address
        self._losses: dict[str, str] = {}
        """By topic: the losses that are not reported yet."""
        self._is_open = True
        self._is_over = False
        self._node.accept(self._note_refused)

    # --- the exchange ---

    def publish(self, envelope: Envelope[Any]) -> None:
        """Hands a message to the subscribers here and, while there are some, elsewhere."""
        self.here.publish(envelope)
        if not self._is_open:
            return
        try:
            outlet = self._outlets[envelope.topic]
        except KeyError:
            outlet = self._open_outlet(envelope.topic)
        if outlet is not None:
            reason = outlet.send(envelope)
            if reason:
                self._count("unsent", envelope.topic, reason)

    def subscribe(self, pattern: str, deliver: Deliver) -> Unsubscribe:
        """Asks for a topic or a pattern of topics, here and elsewhere."""
        subscription = self._sources.get(pattern)
        if subscription is None:
            row = self._topics.row(pattern) or UNKNOWN
            subscription = self._sources[pattern] = _Subscription(
                self._receive_message, DEPTHS.get(row.travels, RELIABLE_DEPTH), self._limit(row.most_hz)
            )
            self._declare(pattern, subscription)
            self._owners.clear()
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
                self._sequences.clear()  # what is not asked for is not lost
                for declared in subscription.declared:
                    declared.undeclare()  # type: ignore[no-untyped-call]
                self._large.drop_unwanted(lambda topic: any(matches(p, topic) for p in self._sources))

        return unsubscribe

    def declare_alive(self, token: str) -> Unsubscribe:
        """Declares here and to other nodes that something is alive; ends at once with this process."""
        withdraw_here = self.here.declare_alive(token)
        key = object()
        self._tokens[key] = (token, self._declare_token(token))

        def withdraw() -> None:
            if key in self._tokens:
                _, declared = self._tokens.pop(key)
                withdraw_here()
                if declared is not None:
                    declared.undeclare()  # type: ignore[no-untyped-call]

        return withdraw

    def watch(self, pattern: str, changed: Callable[[str, bool], None]) -> Unsubscribe:
        """Reports tokens that appear and disappear, here and elsewhere; those of a silent node go after its lease."""
        watch = self._watches.get(pattern)
        if watch is None:
            watch = self._watches[pattern] = _Watch(self._receive_token)
            self._declare_watch(pattern, watch)
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
                if watch.declared is not None:
                    watch.declared.undeclare()  # type: ignore[no-untyped-call]
                for withdraw in watch.tokens.values():
                    withdraw()

        return unwatch

    def close(self) -> None:
        """Stops sending and receiving; queued messages are still sent."""
        self._is_open, self._is_over = False, True
        self._arrivals.close()
        self._close_large()
        self._means.sender.close()
        _end_node(self._node, self._outlets)

    # --- what only this middleware has ---

    async def renew(self, node: ZenohEndpoints, settings: Mapping[str, Any] | None = None) -> None:
        """Replaces the session by a new one, such as after a change of the accepted peers.

        Meanwhile the loop continues, with messages inside this process only.

        Raises:
            Gloc3Error: it cannot be opened; this process is then isolated until it can.
        """
        self._is_open = False
        kept = {topic: outlet.last for topic, outlet in self._outlets.items() if outlet is not None and outlet.last}
        outlets, self._outlets = self._outlets, {}
        for subscription in self._sources.values():
            subscription.declared = []
        for key, (token, _) in self._tokens.items():
            self._tokens[key] = (token, None)
        for watch in self._watches.values():
            watch.declared = None
        self._close_large()

        def change() -> NodeSession:
            _end_node(self._node, outlets)
            opened = open_node(node, settings)
            if self._is_over:
                opened.close()
            return opened

        self._node = await self._loop.run_in_executor(None, change)
        if self._is_over:
            return
        near = NearServer(self._loop) if self._means.near is not None else None
        self._means = self._means._replace(session=self._node.session, near=near)
        self._large = LargeInlet(self._means, self._receive_bytes, self._count)
        self._is_open = True
        self._node.accept(self._note_refused)
        self._sequences.clear()
        for topic, last in kept.items():
            outlet = self._open_outlet(topic)
            if outlet is not None:
                outlet.last = last
        for pattern, subscription in self._sources.items():
            self._declare(pattern, subscription)
        for key, (token, _) in self._tokens.items():
            self._tokens[key] = (token, self._declare_token(token))
        for pattern, watch in self._watches.items():
            tokens, watch.tokens = watch.tokens, {}
            for withdraw in tokens.values():
                withdraw()
            self._declare_watch(pattern, watch)

    def problems(self) -> dict[str, int]:
        """Number of messages lost or refused so far, by keyword and topic, `WORD TOPIC`.

        `unsent`: dropped here, because receivers were too slow; `lost`: gaps in the received sequence, wherever
        dropped; `late`: dropped here, because the loop was too slow (part of the lost); `too_many`: dropped here,
        because one sender sends too often; `too_long`, `damaged`, `versions`, `misplaced`: not accepted. `refused ADDRESS`
        are connections.
        """
        late = {f"late {p}": s.inbound.dropped for p, s in self._sources.items() if s.inbound.dropped}
        for topic, number in self._large.late().items():
            late[f"late {topic}"] = late.get(f"late {topic}", 0) + number
        return {**self._counts, **late}

    # --- connections ---

    def _note_refused(self, refused: Mapping[tuple[str, str], int]) -> None:
        """In a thread: connections were refused."""
        with suppress(RuntimeError):  # at its end the loop takes nothing any more
            self._loop.call_soon_threadsafe(self._count_refused, refused)

    def _count_refused(self, refused: Mapping[tuple[str, str], int]) -> None:
        now_s = self._loop.time()
        self._refused_s = {one: at_s for one, at_s in self._refused_s.items() if now_s - at_s < CALM_S}
        for (address, reason), number in refused.items():
            if address not in self._refused_s:
                self._counts.pop(f"refused {address}", None)
            self._refused_s[address] = now_s
            self._count("refused", address, reason, number)

    # --- out ---

    def _close_large(self) -> None:
        self._large.close()
        if self._means.near is not None:
            self._means.near.close()

    def _open_outlet(self, topic: str) -> TopicOutlet | None:
        """Opens the outlet of a topic; None for a topic whose name cannot be sent."""
        outlet = None
        try:
            outlet = TopicOutlet(self._means, topic, self._topics.row(topic) or UNKNOWN)
        except zenoh.ZError as error:
            self._count("unsent", topic, plain(error))
        self._outlets[topic] = outlet
        return outlet

    def _fail(self, error: BaseException) -> None:
        """In a thread: something could not be sent."""
        self._loop.call_soon_threadsafe(self._count, "unsent", "", str(error))

    # --- in ---

    def _declare(self, pattern: str, subscription: _Subscription) -> None:
        """Asks the others for a pattern, and for the last messages of the latched topics that fit it."""
        if not self._is_open:
            return
        key = key_expression(pattern)
        subscription.declared = [
            self._node.session.declare_subscriber(
                key, self._arrivals.receiver(subscription.inbound), allowed_origin=zenoh.Locality.REMOTE
            )
        ]
        if any(row.is_latched and key.intersects(f"*/{name}") for name, row in self._topics):
            subscription.declared.append(
                self._node.session.liveliness().declare_subscriber(
                    key_expression(latched_token(pattern)),
                    self._arrivals.receiver(Inbound(partial(self._request_last, subscription))),
                    history=True,
                )
            )
        if any(row.travels is TopicService.BULK and key.intersects(f"*/{name}") for name, row in self._topics):
            subscription.declared.append(
                self._node.session.liveliness().declare_subscriber(
                    key_expression(bulk_key(pattern)),
                    self._arrivals.receiver(Inbound(partial(self._receive_bulk, subscription))),
                    history=True,
                )
            )

    def _limit(self, most_hz: float) -> KeyLimit | None:
        if not most_hz:
            return None
        reason = f"more than {most_hz:g} messages a second come from there"
        return KeyLimit(most_hz, self._loop, lambda topic, number: self._count("too_many", topic, reason, number))

    def _declare_watch(self, pattern: str, watch: _Watch) -> None:
        if self._is_open:
            watch.declared = self._node.session.liveliness().declare_subscriber(
                key_expression(pattern), self._arrivals.receiver(watch.inbound), history=True
            )

    def _declare_token(self, token: str) -> zenoh.LivelinessToken | None:
        """Declares a token; it is withdrawn when the returned object is released."""
        return self._node.session.liveliness().declare_token(token) if self._is_open else None

    def _receive_bulk(self, subscription: _Subscription, sample: zenoh.Sample) -> None:
        """Somebody has large messages of a topic, or has them no more."""
        if subscription.users and self._is_open:
            self._large.set_alive(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    def _receive_message(self, subscription: _Subscription, sample: Any) -> None:
        is_answer = isinstance(sample, zenoh.Reply)
        if is_answer:
            if sample.ok is None:
                return
            sample = sample.ok
        topic = topic_of(str(sample.key_expr))
        try:
            owner = self._owners[topic]
        except KeyError:
            owner = self._owners[topic] = next((s for p, s in self._sources.items() if matches(p, topic)), None)
        if owner is subscription:
            longest = (self._topics.row(topic) or UNKNOWN).travels.most_bytes
            if len(sample.payload) > longest:
                self._count("too_long", topic, f"{len(sample.payload):,} bytes are more than its {longest:,}")
                return
            head = sample.attachment
            head_bytes = None if head is None else head.to_bytes()
            self._receive_bytes(topic, head_bytes, sample.payload.to_bytes(), is_answer=is_answer)

    def _receive_bytes(self, topic: str, head: bytes | None, body: bytes, *, is_answer: bool = False) -> None:
        """Handles a message of a subscribed topic, published now or the answer to a request for the last one."""
        types = self._topics.types
        try:
            envelope = types.decode(body) if head is None else types.decode(head, body)
        except WireError as error:
            self._count("versions" if isinstance(error, VersionsDiffer) else "damaged", topic, str(error))
            return
        if envelope.topic != topic:
            self._count("misplaced", topic, f"it says that it is of {envelope.topic}")
            return
        row = self._topics.row(topic)
        if row is not None and row.is_latched:
            last, by_time = self.here.last(topic), is_answer and topic not in self._left
            self._left.discard(topic)
            if last is not None and not _is_newer(envelope, last, by_time=by_time):
                return
        elif len(body) >= LARGE and envelope.sequence <= self._sequences.get((topic, envelope.source), -1):
            return  # while a topic begins its large messages come in two ways
        else:
            self._count_losses(envelope)
        self.here.publish(envelope)

    def _count_losses(self, envelope: Envelope[Any]) -> None:
        key = (envelope.topic, envelope.source)
        before = self._sequences.get(key)
        self._sequences[key] = envelope.sequence
        if before is not None and envelope.sequence > before + 1:
            self._count("lost", envelope.topic, "messages are missing", envelope.sequence - before - 1)

    def _request_last(self, subscription: _Subscription, sample: zenoh.Sample) -> None:
        """Requests the last message of a latched topic from the nodes that hold one, when one of them comes or goes."""
        topic = str(sample.key_expr).replace(f"/{LATCHED}/", "/", 1)
        if sample.kind == zenoh.SampleKind.DELETE and self.here.last(topic) is not None:
            self._left.add(topic)
        if self._is_open:
            self._node.session.get(
                topic,
                self._arrivals.receiver(subscription.inbound),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                allowed_destination=zenoh.Locality.REMOTE,
                timeout=ANSWER_S,
            )

    def _receive_token(self, watch: _Watch, sample: zenoh.Sample) -> None:
        token, is_alive = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
        if is_alive and token not in watch.tokens:
            watch.tokens[token] = self.here.declare_alive(token)
        elif not is_alive and token in watch.tokens:
            watch.tokens.pop(token)()

    def _count(self, kind: str, topic: str, reason: str, number: int = 1) -> None:
        place = f"{kind} {topic}"
        if place not in self._counts and len(self._counts) >= COUNTED_PLACES:
            place = f"{kind} others"
        before = self._counts.get(place, 0)
        self._counts[place] = before + number
        if len(str(before + number)) > len(str(before)) or not before:  # 1, 10, 100, …
            text = f"{place}: {reason} ({before + number} so far)"
            if kind != "lost":
                self.troubled(kind, text)
                return
            if not self._losses:
                self._loop.call_later(BREAK_S, self._report_losses)
            self._losses[place] = text

    def _report_losses(self) -> None:
        (first, *others), self._losses = self._losses.values(), {}
        if self._is_open:
            self.troubled("lost", first + (f"; and of {counted(len(others), 'other topic')}" if others else ""))


def _is_newer(one: Envelope[Any], other: Envelope[Any], *, by_time: bool) -> bool:
    """Whether a message is newer: within one life of its source by its number, else by its time or in any case.

    The time begins again when the computer that keeps it is started again.
    """
    if one.source == other.source:
        return one.sequence > other.sequence
    return not by_time or one.t_s > other.t_s


class _Subscription:
    """One pattern subscribed to from other nodes."""

    def __init__(self, handle: Callable[[_Subscription, Any], None], depth: int, limit: KeyLimit | None) -> None:
        self.inbound = Inbound(partial(handle, self), depth, limit)
        self.users = 0
        self.declared: list[zenoh.Subscriber[None]] = []


class _Watch:
    """One pattern of tokens watched on other nodes."""

    def __init__(self, handle: Callable[[_Watch, Any], None]) -> None:
        self.declared: zenoh.Subscriber[None] | None = None
        self.inbound = Inbound(partial(handle, self))
        self.tokens: dict[str, Unsubscribe] = {}
        self.users = 0


def _end_node(node: NodeSession, outlets: Mapping[str, TopicOutlet | None]) -> None:
    for outlet in outlets.values():
        if outlet is not None:
            outlet.close()
    node.close()


def key_expression(pattern: str) -> zenoh.KeyExpr:
    """A topic pattern as a Zenoh key expression, never narrower: a wildcard for part of a level becomes `$*`."""
    levels = [level if level in ("*", "**") else PART.sub("$*", level) for level in pattern.split("/")]
    return zenoh.KeyExpr.autocanonize("/".join(levels))
