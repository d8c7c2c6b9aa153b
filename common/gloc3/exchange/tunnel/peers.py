"""All peers of one end: detects new, silent and restarted peers, and duplicate names."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from gloc3.exchange.tunnel.events import Counters, Happening, PeerChanged, TokenChanged, TunnelTrouble, Undelivered
from gloc3.exchange.tunnel.frames import Echo, TableRequest, TunnelHello
from gloc3.exchange.tunnel.layout import TunnelRole
from gloc3.exchange.tunnel.path import PeerClock, RoundTrips
from gloc3.exchange.tunnel.receiving import ReliableReceiver
from gloc3.exchange.tunnel.sending import ReliableSender
from gloc3.exchange.tunnel.status import StatusReceiver
from gloc3.exchange.tunnel.table import PeerTable, TunnelChannel
from gloc3.mavlink.message import Address

SILENT_AFTER_S: Final = 8.0
REQUEST_SPACING_S: Final = 0.4
REQUEST_LIMIT: Final = 40
LIVES_REMEMBERED: Final = 8


class Peer:
    """The other end of the link, or one of several."""

    def __init__(
        self, address: Address, hello: TunnelHello, boot: int, first_number: int, counters: Counters, now_s: float
    ) -> None:
        self._counters = counters
        self.address: Final = address
        self.role: Final = hello.role
        self.name = hello.name
        self.is_alive = True
        self.received_s = now_s
        self.former: dict[int, ReliableReceiver] = {}
        """Receivers of former lives, by boot: one that returns has nothing handed over twice."""
        self.since_s = now_s
        """When the first frame of this life was received."""
        self._begin(boot, first_number)

    def _begin(self, boot: int, first_number: int) -> None:
        self.boot = boot
        self.clock = PeerClock()
        self.round_trips = RoundTrips()
        self.table = PeerTable()
        self.sender = ReliableSender(boot, first_number, self.round_trips, self._counters)
        self.receiver = ReliableReceiver(self._counters)
        self.status = StatusReceiver(self._counters)
        self.wanted: list[int] = []
        """Rows of this end's table that it has requested."""
        self.known: set[int] = set()
        """Channels of this end on which it has acknowledged a message."""
        self.tokens: tuple[str, ...] = ()
        self._token_numbers: tuple[int, ...] = ()
        self._hello: tuple[int, float] | None = None
        self._requested_s = -REQUEST_SPACING_S

    def restart(self, boot: int, first_number: int, now_s: float) -> None:
        """Begins another life, new or returned, and forgets all of the present one but what it has handed over."""
        returned = self.former.pop(boot, None)
        for receiver in self.former.values():
            receiver.drop_incomplete()
        self.former[self.boot] = self.receiver
        if len(self.former) > LIVES_REMEMBERED:
            del self.former[next(iter(self.former))]
        self.since_s = now_s
        self._begin(boot, first_number)
        self.receiver = returned or self.receiver

    def send_hello(self, hello: TunnelHello, own: Address, now_s: float) -> float | None:
        """Handles a hello; returns the round trip if it contains an echo."""
        self._hello = (hello.sent_ms & 0xFFFFFFFF, now_s)
        self._token_numbers = hello.tokens
        self.name = hello.name
        self.table.announce(hello.table_size)
        for echo in hello.echoes:
            if (echo.system, echo.component) == own:
                now_ms = round(now_s * 1000.0)
                requested_s = now_s - ((now_ms - echo.sent_ms) & 0xFFFFFFFF) / 1000.0
                return self.clock.sample(requested_s, hello.sent_ms / 1000.0, echo.held_ms / 1000.0, now_s)
        return None

    def echo(self, now_s: float) -> Echo | None:
        """Echo of this peer's last hello, with which it compares the clocks; None without a recent one."""
        if self._hello is None or now_s - self._hello[1] > 60.0:
            return None
        return Echo(*self.address, self._hello[0], round((now_s - self._hello[1]) * 1000.0))

    def live_tokens(self) -> tuple[str, ...]:
        """What it says is alive, as far as its table is here."""
        if not self.is_alive:
            return ()
        channels = (self.table.find(number) for number in self._token_numbers)
        return tuple(channel.topic for channel in channels if channel is not None and channel.source is None)

    def channel(self, number: int) -> TunnelChannel | None:
        """Channel of a number of its table; None where its row has to be requested."""
        return self.table.find(number)

    def request_s(self) -> float | None:
        """When rows of its table have to be requested; None while none is missing."""
        if not self.is_alive or not self.table.missing(1):
            return None
        return self._requested_s + max(REQUEST_SPACING_S, 0.6 * self.round_trips.smoothed_s)

    def request(self, now_s: float) -> TableRequest:
        """The question for the rows that are missing."""
        self._requested_s = now_s
        return TableRequest(self.table.missing(REQUEST_LIMIT))

    @property
    def silent_s(self) -> float:
        """When it counts as lost unless a frame arrives."""
        return self.received_s + SILENT_AFTER_S


MAX_PEERS: Final = 128
"""A station has a hundred vehicles behind one link, and room for some more."""
DROP_AFTER_S: Final = 300.0
"""Silence after which a peer is removed, with its waiting messages, s."""
MAKE_ROOM_AFTER_S: Final = 130.0
"""Silence after which a peer may be replaced by a new one when there are too many, s. It exceeds the time over which
a message is repeated, so that no repeat is taken for a new message if that peer comes back."""
GHOST_AFTER_S: Final = 3.0
"""Frames of a former life are late until then; afterwards two processes share an address. The former one is accepted
again when the present one has been silent for so long: it has ended."""
MAX_PROBLEMS: Final = 256


class TunnelPeers:
    """The peers of the other role, by address, in the order of first contact.

    Args:
        role: of this end.
        name: of this end.
        own: its own address.
        counters: where frames of other lives are counted.
        report: called with events for the layer above.
    """

    def __init__(
        self, role: TunnelRole, name: str, own: Address, counters: Counters, report: Callable[[Happening], None]
    ) -> None:
        self._role = role
        self._name = name
        self._own = own
        self._counters = counters
        self._report = report
        self._peers: dict[Address, Peer] = {}
        self._first_number = 0
        self._problems: set[tuple[Address, str]] = set()

    def __iter__(self) -> Iterator[Peer]:
        return iter(self._peers.values())

    def find(self, address: Address, boot: int) -> Peer | None:
        """The peer in this life; None where it has not greeted yet, or is no more."""
        peer = self._peers.get(address)
        return peer if peer is not None and peer.boot == boot else None

    def at(self, address: Address) -> Peer | None:
        """The peer at an address, in whatever life."""
        return self._peers.get(address)

    def named(self, name: str) -> Peer | None:
        """The peer of this name; one that is alive goes first."""
        found = [peer for peer in self if peer.name == name]
        return next((peer for peer in found if peer.is_alive), found[0] if found else None)

    def send_hello(self, address: Address, hello: TunnelHello, boot: int, now_s: float) -> Peer | None:
        """Handles a hello; returns the peer, or None where it is not accepted as one."""
        if address == self._own:
            self.problem(address, f"another process uses our address {address.system}/{address.component}")
            return None
        if hello.role is self._role:
            if hello.name == self._name:
                self.problem(address, f"another {self._role.name.lower()} calls itself {self._name}")
            return None
        peer = self._peers.get(address)
        if peer is None:
            if not self._make_room(now_s):
                self._counters.too_many_peers += 1
                return None
            peer = self._peers[address] = Peer(address, hello, boot, self._number(), self._counters, now_s)
            self._report(PeerChanged(address, peer.name, peer.role, True))
            self._check_name(peer)
        elif boot != peer.boot:
            if boot in peer.former and not self._has_fallen_silent(peer, now_s):
                self._counters.other_life += 1
                return None
            self._restart(peer, boot, now_s)
        round_trip_s = peer.send_hello(hello, self._own, now_s)
        if round_trip_s is not None:
            peer.round_trips.sample(round_trip_s, now_s)
        self.note_contact(peer, now_s)
        self.refresh(peer)
        return peer

    def note_contact(self, peer: Peer, now_s: float) -> None:
        """Something came from a peer."""
        peer.received_s = now_s
        if not peer.is_alive:
            peer.is_alive = True
            self._report(PeerChanged(peer.address, peer.name, peer.role, True))
            self.refresh(peer)

    def refresh(self, peer: Peer) -> None:
        """Reports tokens that have appeared or disappeared at a peer."""
        before, peer.tokens = peer.tokens, peer.live_tokens()
        for token in before:
            if token not in peer.tokens:
                self._report(TokenChanged(token, False))
        for token in peer.tokens:
            if token not in before:
                self._report(TokenChanged(token, True))

    def tick(self, now_s: float) -> None:
        """Marks peers that have gone silent, and removes those that have been silent for long."""
        for peer in list(self):
            if peer.is_alive and now_s >= peer.silent_s:
                peer.is_alive = False
                self._report(PeerChanged(peer.address, peer.name, peer.role, False))
                self.refresh(peer)
            if now_s >= peer.received_s + DROP_AFTER_S:
                self._drop(peer)

    def next_s(self) -> float | None:
        """When `tick` has something to do."""
        return min(
            (peer.silent_s if peer.is_alive else peer.received_s + DROP_AFTER_S for peer in self),
            default=None,
        )

    def problem(self, address: Address, text: str, kind: str = "") -> None:
        """Tells a trouble, once; one of a kind only the first time."""
        key = (address, kind or text)
        if key not in self._problems and len(self._problems) < MAX_PROBLEMS:
            self._problems.add(key)
            self._report(TunnelTrouble(address, text))

    def _has_fallen_silent(self, peer: Peer, now_s: float) -> bool:
        """Whether a peer's present life has ended, when a former one greets; two that live are reported."""
        address = peer.address
        if now_s - peer.since_s > GHOST_AFTER_S:
            self.problem(address, f"two processes use the address {address.system}/{address.component}")
        return now_s - peer.received_s > GHOST_AFTER_S

    def _restart(self, peer: Peer, boot: int, now_s: float) -> None:
        """Handles a new process at a peer's address: messages that the old one cannot have received are sent to it."""
        waiting = peer.sender.waiting()
        for token in peer.tokens:
            self._report(TokenChanged(token, False))
        peer.restart(boot, self._number(), now_s)
        self._report(PeerChanged(peer.address, peer.name, peer.role, True, is_restarted=True))
        for outgoing, may_have_arrived in waiting:
            if may_have_arrived:
                reason = f"{peer.name} restarted before it had acknowledged"
                self._give_up(Undelivered(outgoing.envelope, peer.address, False, reason))
            else:
                peer.sender.submit(outgoing, now_s)

    def _drop(self, peer: Peer) -> None:
        for outgoing, may_have_arrived in peer.sender.waiting():
            reason = f"{peer.name} has been silent for {DROP_AFTER_S:.0f} s"
            self._give_up(Undelivered(outgoing.envelope, peer.address, not may_have_arrived, reason))
        self._first_number = self._number()
        del self._peers[peer.address]

    def _give_up(self, undelivered: Undelivered) -> None:
        self._counters.undelivered += 1
        self._report(undelivered)

    def _number(self) -> int:
        """A message number that this process has never used, so that a peer that returns does not confuse messages."""
        return max(self._first_number, *(peer.sender.next_number for peer in self), 0)

    def _make_room(self, now_s: float) -> bool:
        if len(self._peers) < MAX_PEERS:
            return True
        silent = [peer for peer in self if now_s - peer.received_s > MAKE_ROOM_AFTER_S]
        if silent:
            self._drop(min(silent, key=lambda peer: peer.received_s))
        return bool(silent)

    def _check_name(self, peer: Peer) -> None:
        for other in self:
            if other is not peer and other.is_alive and other.name == peer.name:
                self.problem(peer.address, f"two {peer.role.name.lower()}s call themselves {peer.name}")
