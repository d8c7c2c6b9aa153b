"""MAVLink over UDP: a listener that replies to every known sender, and a sender to one address."""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from ipaddress import ip_address
from typing import Any, Final, TypeAlias

from gloc3.errors import Refused
from gloc3.mavlink.codec import Parser
from gloc3.mavlink.fair_share import to_evict
from gloc3.mavlink.parser import MAGIC_1, MAGIC_2, SIGNATURE_LENGTH, SIGNED
from gloc3.mavlink.transport.pinning import AutopilotPins

RECEIVE_BUFFER_BYTES: Final = 1 << 22
"""Kernel buffer for unread data, as far as permitted, bytes: half a second of 10,000 datagrams a second."""
_RCVBUFFORCE: Final = 33
"""SO_RCVBUFFORCE of Linux, which the socket module does not name."""
LARGEST_DATAGRAM_BYTES: Final = 65_535
DATAGRAMS_AT_ONCE: Final = 256
"""Datagrams read before the rest of the process gets a turn."""
SOON_S: Final = 1e-4
"""Gap after the last datagrams within which more may be waiting, so that a further read is worthwhile, s."""
MOST_PEERS: Final = 128
CHECK_SILENT_S: Final = 1.0
"""Shortest interval between checks for silent peers, s."""
PEER_EXPIRES_S: Final = 30.0
"""Silence after which a peer is no longer sent to and makes room for another, s."""
_AROUND_1: Final = 8
_AROUND_2: Final = 12
"""Bytes of a frame around its payload: header and checksum."""

SocketAddress: TypeAlias = tuple[Any, ...]


class UdpEndpoint:
    """A UDP socket that never blocks."""

    is_datagram = True

    def __init__(
        self,
        url: str,
        loop: asyncio.AbstractEventLoop,
        on_data: Callable[[bytes], None],
        *,
        pins_autopilot: bool = False,
    ) -> None:
        self.url = url
        self.bytes_sent = 0
        self.bytes_received = 0
        self.dropped = 0
        self.problem = ""
        self.origin = ""
        self._loop, self._now_s = loop, loop.time
        self._on_data = on_data
        self._socket: socket.socket | None = None
        self._read_s = 0.0
        self._addresses: Sequence[SocketAddress] = ()
        """Those that are sent to."""
        self._pins = AutopilotPins() if pins_autopilot else None

    @property
    def intruder(self) -> str:
        """The recent peer that claims the id of another peer's autopilot; empty without one."""
        return "" if self._pins is None else self._pins.intruder(self._now_s())

    @property
    def local_port(self) -> int | None:
        """The port that the socket has."""
        return None if self._socket is None else int(self._socket.getsockname()[1])

    async def close(self) -> None:
        """Closes the socket."""
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def _start(self, opened: socket.socket) -> None:
        opened.setblocking(False)
        enlarge(opened, RECEIVE_BUFFER_BYTES)
        self._socket = opened
        self._loop.add_reader(opened, self._read)

    def _read(self) -> None:
        """Reads received datagrams; at low traffic without the extra read of an empty socket, a tenth of the cost."""
        now_s = self._now_s()
        left = DATAGRAMS_AT_ONCE if now_s < self._read_s + SOON_S else 1
        self._read_s = now_s
        while left and (opened := self._socket) is not None:  # a receiver may close it
            left -= 1
            try:
                data, sender = opened.recvfrom(LARGEST_DATAGRAM_BYTES)
            except (BlockingIOError, InterruptedError):
                break
            except OSError as error:  # the peer's port is closed; the next datagram may be received again
                self.problem = str(error)
                continue
            self._receive(data, sender, now_s)

    def _receive(self, data: bytes, sender: SocketAddress, now_s: float) -> None:
        raise NotImplementedError

    def _is_intruder(self, data: bytes, sender: SocketAddress, now_s: float) -> bool:
        """Whether a datagram claims to be from an autopilot that is heard from another peer; counts it then."""
        if self._pins is None:
            return False
        name = f"{sender[0]}:{sender[1]}"
        is_intruder = any(self._pins.is_intruder(who, sender, name, now_s) for who in senders_in(data))
        self.dropped += is_intruder
        return is_intruder

    def send(self, data: bytes) -> None:
        """Sends one datagram to each address that it is for."""
        if (opened := self._socket) is None:
            return
        for address in self._addresses if len(self._addresses) <= 1 else self._addresses_for(data):
            try:
                self.bytes_sent += opened.sendto(data, address)
            except OSError as error:
                self.dropped += 1
                if not isinstance(error, BlockingIOError):
                    self.problem = str(error)

    def _addresses_for(self, frames: bytes) -> Sequence[SocketAddress]:
        """Those of several addresses to which frames are to be sent."""
        raise NotImplementedError


class UdpPeer:
    """Somebody who has sent here."""

    __slots__ = ("heard_s", "systems")

    def __init__(self) -> None:
        self.heard_s = 0.0
        self.systems: frozenset[int] = frozenset()
        """Those that are behind it; one peer may stand for many, as a router does."""


class UdpServerEndpoint(UdpEndpoint):
    """Listens; sends to every recent peer, and frames for one system only to the peers behind which that system is."""

    def __init__(
        self,
        url: str,
        loop: asyncio.AbstractEventLoop,
        on_data: Callable[[bytes], None],
        *,
        pins_autopilot: bool = False,
    ) -> None:
        super().__init__(url, loop, on_data, pins_autopilot=pins_autopilot)
        self.unknown_refused = 0
        """Datagrams of peers for which there was no room."""
        self._peers: dict[SocketAddress, UdpPeer] = {}
        self._checked_s = 0.0
        self._parser = Parser(is_datagram=True)

    @classmethod
    async def open(
        cls,
        url: str,
        loop: asyncio.AbstractEventLoop,
        on_data: Callable[[bytes], None],
        host: str,
        port: int,
        *,
        pins_autopilot: bool = False,
    ) -> UdpServerEndpoint:
        """Binds the port; with `pins_autopilot`, ignores a second peer that claims the id of a first peer's autopilot.

        Raises:
            Refused: the port is in use or not allowed, or the host is not an address of this computer.
        """
        family, address = await resolve(url, loop, host, port, socket.SOCK_DGRAM)
        opened = socket.socket(family, socket.SOCK_DGRAM)
        try:
            opened.bind(address)
        except OSError as error:
            opened.close()
            raise Refused(bind_failure(url, port, error)) from None
        endpoint = cls(url, loop, on_data, pins_autopilot=pins_autopilot)
        endpoint._start(opened)
        return endpoint

    @property
    def peers(self) -> list[SocketAddress]:
        """Addresses of recent peers, which are sent to."""
        self._remove_silent(self._now_s())
        return list(self._addresses)

    @property
    def is_connected(self) -> bool:
        """Whether there is a recent peer."""
        since_s = self._now_s() - PEER_EXPIRES_S
        return any(peer.heard_s >= since_s for peer in tuple(self._peers.values()))

    def send(self, data: bytes) -> None:
        """Sends one datagram to each peer that it is for."""
        super().send(data)
        if (now_s := self._now_s()) > self._checked_s + CHECK_SILENT_S:
            self._remove_silent(now_s)

    def _addresses_for(self, frames: bytes) -> Sequence[SocketAddress]:
        """Where frames are to be sent: to all, unless every frame is for systems whose peers are known.

        The MAVLink guide wants a frame to go where its target system was heard from.
        """
        targets = {frame.target_system for frame in self._parser.receive(frames)}
        if not targets or 0 in targets:
            return self._addresses
        found = {address: peer.systems for address, peer in self._peers.items() if targets & peer.systems}
        return tuple(found) if targets <= frozenset().union(*found.values()) else self._addresses

    def _receive(self, data: bytes, sender: SocketAddress, now_s: float) -> None:
        peer = self._peers.get(sender)
        if peer is None and not self._make_room(sender[0], now_s):
            self.unknown_refused += 1
            return
        if self._is_intruder(data, sender, now_s):
            return
        if peer is None:
            peer = self._peers[sender] = UdpPeer()
            self._addresses = tuple(self._peers)
        peer.heard_s = now_s
        size = len(data)
        if not (size >= _AROUND_2 and data[0] == MAGIC_2 and size == data[1] + _AROUND_2 and data[5] in peer.systems):
            peer.systems = peer.systems.union(
                system for system, _ in senders_in(data)
            )  # not one plain frame of one known
        self.bytes_received += size
        self.origin = sender[0]
        self._on_data(data)

    def _make_room(self, host: str, now_s: float) -> bool:
        """Whether there is room for one more peer of a host; of the host that has most, the newest may make it."""
        if len(self._peers) >= MOST_PEERS:
            self._remove_silent(now_s)
        if len(self._peers) < MOST_PEERS:
            return True
        evicted = to_evict({address: address[0] for address in self._peers}, host)
        if evicted is None:
            return False
        del self._peers[evicted]
        self._addresses = tuple(self._peers)
        return True

    def _remove_silent(self, now_s: float) -> None:
        self._checked_s = now_s
        for address in [address for address, peer in self._peers.items() if peer.heard_s < now_s - PEER_EXPIRES_S]:
            del self._peers[address]
            self._addresses = tuple(self._peers)


class UdpClientEndpoint(UdpEndpoint):
    """Sends to one address; receives only from that host, whichever of its ports it answers from."""

    def __init__(
        self,
        url: str,
        loop: asyncio.AbstractEventLoop,
        on_data: Callable[[bytes], None],
        address: SocketAddress,
        *,
        pins_autopilot: bool = False,
    ) -> None:
        super().__init__(url, loop, on_data, pins_autopilot=pins_autopilot)
        self._addresses = (address,)

    @classmethod
    async def open(
        cls,
        url: str,
        loop: asyncio.AbstractEventLoop,
        on_data: Callable[[bytes], None],
        host: str,
        port: int,
        *,
        pins_autopilot: bool = False,
    ) -> UdpClientEndpoint:
        """Finds the host's address; `pins_autopilot` is that of `UdpServerEndpoint.open`.

        Raises:
            Refused: the host has none.
        """
        family, address = await resolve(url, loop, host, port, socket.SOCK_DGRAM)
        opened = socket.socket(family, socket.SOCK_DGRAM)
        here, anywhere = ("::1", "::") if family == socket.AF_INET6 else ("127.0.0.1", "0.0.0.0")
        opened.bind((here if is_loopback(address[0]) else anywhere, 0))  # what is for this computer, no other reaches
        endpoint = cls(url, loop, on_data, address, pins_autopilot=pins_autopilot)
        endpoint._start(opened)
        return endpoint

    @property
    def is_connected(self) -> bool:
        """Whether it is open; UDP does not show whether there is a peer."""
        return self._socket is not None

    def _receive(self, data: bytes, sender: SocketAddress, now_s: float) -> None:
        if sender[0] == self._addresses[0][0] and not self._is_intruder(data, sender, now_s):
            self.bytes_received += len(data)
            self._on_data(data)


def senders_in(datagram: bytes) -> Iterator[tuple[int, int]]:
    """System and component of each frame of a datagram; ends at the first damaged frame."""
    at, size = 0, len(datagram)
    while at + _AROUND_1 <= size:
        length = datagram[at + 1]
        if datagram[at] == MAGIC_2 and at + _AROUND_2 <= size:
            yield datagram[at + 5], datagram[at + 6]
            at += length + _AROUND_2 + (SIGNATURE_LENGTH if datagram[at + 2] & SIGNED else 0)
        elif datagram[at] == MAGIC_1:
            yield datagram[at + 3], datagram[at + 4]
            at += length + _AROUND_1
        else:
            return


def is_loopback(host: str) -> bool:
    """Whether only this computer reaches what listens on a host's address."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def enlarge(opened: socket.socket, size: int) -> None:
    """Enlarges a socket's receive buffer: beyond the system's limit where permitted, else up to it."""
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)
    with suppress(OSError):
        opened.setsockopt(socket.SOL_SOCKET, _RCVBUFFORCE, size)


async def resolve(
    url: str, loop: asyncio.AbstractEventLoop, host: str, port: int, kind: socket.SocketKind
) -> tuple[socket.AddressFamily, SocketAddress]:
    """The first address of a host.

    Raises:
        Refused: it has none.
    """
    try:
        found = await loop.getaddrinfo(host, port, type=kind)
    except OSError as error:
        raise Refused(f"{url}: no address for host {host!r}: {error.strerror or error}") from None
    family, _, _, _, address = found[0]
    return family, address


def bind_failure(url: str, port: int, error: OSError) -> str:
    """Why a port cannot be had, for a person."""
    match error.errno:
        case errno.EADDRINUSE:
            return f"{url}: port {port} is in use by another program"
        case errno.EADDRNOTAVAIL:
            return f"{url}: this computer does not have that address; 0.0.0.0 listens on all that it has"
        case errno.EACCES:
            return f"{url}: port {port} needs more rights than we have"
        case _:
            return f"{url}: {error.strerror or error}"
