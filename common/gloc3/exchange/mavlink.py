"""MAVLink exchange: the command link between stations and platforms over any MAVLink connection (DESIGN §4).

A thin shell around `gloc3.exchange.tunnel.endpoint.TunnelEndpoint`, which does the work without I/O. Times of validity
stay in the clock of the platform that stamped them; `clock_offset_s` returns its offset from the local clock.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Any, Final

from gloc3.exchange.base import Deliver, Exchange, LocalExchange, Unsubscribe
from gloc3.exchange.tunnel.endpoint import TunnelEndpoint
from gloc3.exchange.tunnel.events import Delivered, Happening, TokenChanged
from gloc3.exchange.tunnel.layout import PAYLOAD_TYPE, TunnelRole
from gloc3.exchange.tunnel.routes import route
from gloc3.mavlink.codec import message as make
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.messages.envelope import Envelope
from gloc3.messages.topics import TopicTable

SMALLEST_WAIT_S: Final = 1e-3
FEW_PEERS: Final = 8
"""Up to this many peers, received messages are handled at once."""
CROWD_WAIT_S: Final = 0.05
"""Delay of handling with more peers, because every pass visits all of them, s."""


class MavlinkExchange:
    """A data exchange over one MAVLink link: messages published here that cross the link appear at the other end.

    A platform sends its status to all stations, replies to the station that sent the request, events to all, and
    receives requests; a station does the reverse. Publications also reach local subscribers, as on every middleware.

    Args:
        endpoint: this end of the link.
        loop: the event loop, for time and timers.
        send: sends a MAVLink message on the link.
    """

    def __init__(
        self, endpoint: TunnelEndpoint, loop: asyncio.AbstractEventLoop, send: Callable[[MavlinkMessage], None]
    ) -> None:
        self.endpoint: Final = endpoint
        self._loop = loop
        self._send = send
        self.here: Final = LocalExchange(endpoint.topics)
        """What passes at this end, unless it is joined to another middleware."""
        self._deliver: Deliver = self.here.publish
        """Delivers messages received over the link."""
        self._own_tokens: dict[str, int] = {}
        self._peer_tokens: dict[str, list[Unsubscribe]] = {}
        self._listeners: list[Callable[[Happening], None]] = []
        self._on_event: deque[Happening] = deque()
        self._timer: asyncio.Handle | None = None
        self._is_due = False
        self._is_open = True
        self._wake()

    # --- the exchange ---

    def publish(self, envelope: Envelope[Any]) -> None:
        """Sends a message to subscribers here and, if its topic crosses the link, at the other end."""
        self.here.publish(envelope)
        self._send_over(envelope)

    def _send_over(self, envelope: Envelope[Any]) -> None:
        self.endpoint.publish(envelope, self._loop.time())
        self._wake()

    def subscribe(self, pattern: str, deliver: Deliver) -> Unsubscribe:
        """Asks for a topic or a pattern of topics."""
        return self.here.subscribe(pattern, deliver)

    def declare_alive(self, token: str) -> Unsubscribe:
        """Declares here and at the other end that something is alive.

        Raises:
            Refused: too many tokens; the link is for those of whole stations and platforms, not of every component.
        """
        if not self._own_tokens.get(token):
            self.endpoint.declare(token)
        self._own_tokens[token] = self._own_tokens.get(token, 0) + 1
        withdraw_here = self.here.declare_alive(token)
        is_open = True

        def withdraw() -> None:
            nonlocal is_open
            if is_open:
                is_open = False
                withdraw_here()
                self._own_tokens[token] -= 1
                if not self._own_tokens[token]:
                    self.endpoint.withdraw(token)
                    self._wake()

        self._wake()
        return withdraw

    def watch(self, pattern: str, changed: Callable[[str, bool], None]) -> Unsubscribe:
        """Reports tokens that appear and disappear, here and at the other end; those of a silent peer disappear."""
        return self.here.watch(pattern, changed)

    # --- what only this middleware has ---

    def listen(self, reported: Callable[[Happening], None]) -> Unsubscribe:
        """Reports events of the link: peers, acknowledged and undelivered messages, problems."""
        self._listeners.append(reported)
        return lambda: self._listeners.remove(reported) if reported in self._listeners else None

    def bridge(
        self,
        other: Exchange,
        topics: TopicTable,
        platform: str = "*",
        inward: Callable[[Envelope[Any]], Envelope[Any] | None] = lambda envelope: envelope,
        outward: Callable[[Envelope[Any]], bool] = lambda _: True,
    ) -> Unsubscribe:
        """Joins this link and another middleware, each topic in its direction; local publications stay local.

        Args:
            other: the middleware on this side, such as the local one.
            topics: the topics that may cross.
            platform: at a platform its name; at a station all of them.
            inward: converts each incoming message; None drops it.
            outward: whether a message is sent.
        """

        def receive(envelope: Envelope[Any]) -> None:
            used = inward(envelope)
            if used is not None:
                other.publish(used)

        def send_out(envelope: Envelope[Any]) -> None:
            if outward(envelope):
                self._send_over(envelope)

        undo = []
        for name, row in topics:
            topic_route = route(name, row)
            if topic_route is None:
                continue
            if topic_route.sender is self.endpoint.role:
                undo.append(other.subscribe(f"{platform}/{name}", send_out))
        self._deliver = receive

        def part() -> None:
            self._deliver = self.here.publish
            for unsubscribe in undo:
                unsubscribe()

        return part

    def clock_offset_s(self, name: str) -> float | None:
        """A peer's clock minus ours, from the quickest of the last greetings; None while it is not known."""
        best = next((peer.clock.best for peer in self.endpoint.peers() if peer.name == name), None)
        return None if best is None else best.offset_s

    def round_trip_s(self, name: str) -> float | None:
        """Round-trip time of the last hello to a peer, s; None while it is unknown."""
        last = next((peer.clock.latest for peer in self.endpoint.peers() if peer.name == name), None)
        return None if last is None else last.round_trip_s

    def received_age_s(self, name: str) -> float | None:
        """How long ago anything came from a peer; None for one that is not known."""
        received_s = [peer.received_s for peer in self.endpoint.peers() if peer.name == name]
        return self._loop.time() - max(received_s) if received_s else None

    # --- the link ---

    def receive(self, message: MavlinkMessage, sender: Address) -> None:
        """Takes a TUNNEL message from the link; others, and those of other payload types, are ignored."""
        if self._is_open and message.name == "TUNNEL" and message.payload_type == PAYLOAD_TYPE:
            self.endpoint.receive(message, sender, self._loop.time())
            if len(self.endpoint.peers()) <= FEW_PEERS:
                self._wake()
            else:
                self._wake_within(CROWD_WAIT_S)

    def close(self) -> None:
        """Stops sending and receiving."""
        self._is_open = False
        if self._timer is not None:
            self._timer.cancel()

    def _wake(self) -> None:
        """Runs as soon as the caller is done, once."""
        if self._is_open and not self._is_due:
            self._is_due = True
            if self._timer is not None:
                self._timer.cancel()
            self._timer = self._loop.call_soon(self._run)

    def _wake_within(self, wait_s: float) -> None:
        """Runs in a little while at the latest: what many peers say meanwhile is worked off together."""
        when_s = self._loop.time() + wait_s
        if not self._is_open or self._is_due:
            return
        if isinstance(self._timer, asyncio.TimerHandle):
            if self._timer.when() <= when_s:
                return
            self._timer.cancel()
        self._timer = self._loop.call_at(when_s, self._run)

    def _run(self) -> None:
        self._is_due, self._timer = False, None
        try:
            self._work(self._loop.time())
        finally:  # a subscriber's error ends neither the link nor what else was to be told
            if self._on_event:
                self._wake()
            elif self._is_open and not self._is_due:
                when_s = max(self.endpoint.next_tick_s(), self._loop.time() + SMALLEST_WAIT_S)
                self._timer = self._loop.call_at(when_s, self._run)

    def _work(self, now_s: float) -> None:
        self.endpoint.tick(now_s)
        self._on_event.extend(self.endpoint.events())
        while self._on_event:  # first, so that nothing is acknowledged that was not handed over
            self._handle_event(self._on_event.popleft())
        for system, component, payload in self.endpoint.outgoing(now_s):
            self._send(
                make(
                    "TUNNEL",
                    target_system=system,
                    target_component=component,
                    payload_type=PAYLOAD_TYPE,
                    payload_length=len(payload),
                    payload=payload,
                )
            )

    def _handle_event(self, happening: Happening) -> None:
        match happening:
            case Delivered(envelope=envelope):
                self._deliver(envelope)
            case TokenChanged(token=token, is_alive=True):
                self._peer_tokens.setdefault(token, []).append(self.here.declare_alive(token))
            case TokenChanged(token=token):
                withdraw = self._peer_tokens.get(token)
                if withdraw:
                    withdraw.pop()()
            case _:
                for reported in tuple(self._listeners):
                    reported(happening)


__all__ = ["MavlinkExchange", "TunnelEndpoint", "TunnelRole"]
