"""MAVLink over UDP: a listener that answers everyone it has heard from, and a sender to one address."""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, TypeAlias

from gloc3.errors import Refused
from gloc3.link.peer_routes import Routes

RECEIVE_BUFFER_BYTES: Final = 1 << 20
"""The loop wakes for a burst, not for each datagram; the kernel keeps the rest of it here."""
_RCVBUFFORCE: Final = 33
"""SO_RCVBUFFORCE of Linux, which the socket module does not name."""
LARGEST_DATAGRAM_BYTES: Final = 65_535
DATAGRAMS_AT_ONCE: Final = 256
"""After so many the rest of the process has its turn."""
MOST_PEERS: Final = 128
LOOK_AGAIN_S: Final = 1.0
"""So often at most the silent ones are looked for."""
PEER_EXPIRES_S: Final = 30.0
"""Who has said nothing for so long is not sent to any more, and makes room for another."""

SocketAddress: TypeAlias = tuple[Any, ...]


class UdpEndpoint:
    """What both have in common: a socket that never blocks, read until it is empty."""

    is_datagram = True

    def __init__(self, url: str, loop: asyncio.AbstractEventLoop, on_data: Callable[[bytes], None]) -> None:
        self.url = url
        self.bytes_received = 0
        self.bytes_sent = 0
        self.dropped = 0
        self.problem = ""
        self._loop = loop
        self._on_data = on_data
        self.quick: Callable[[bytes], bool] | None = None
        """Is offered what comes from whom has just been heard, and says whether that was all that is to be done with it."""
        self._socket: socket.socket | None = None
        self._most = DATAGRAMS_AT_ONCE
        self._sender: SocketAddress | None = None
        """Who was heard last."""
        self._is_heard = False
        """Whether more came from there since it was looked last who is silent."""

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
        promptly = getattr(self._loop, "read_promptly", None)  # see `gloc3.link.prompt_loop`
        if promptly is None:
            self._loop.add_reader(opened, self._read)
        else:
            self._most = 1  # to be called again costs less than to find that there is nothing more
            promptly(opened.fileno(), self._read)

    def _read(self) -> None:
        left = self._most
        while left and self._socket is not None:  # who is told may close it
            left -= 1
            try:
                data, sender = self._socket.recvfrom(LARGEST_DATAGRAM_BYTES)
            except (BlockingIOError, InterruptedError):
                return
            except OSError as error:  # nobody listens there (any more); the next one may be heard again
                self.problem = str(error)
                continue
            if sender == self._sender and self.quick is not None and self.quick(data):
                self.bytes_received += len(data)
                self._is_heard = True
            else:
                self._hear(data, sender)

    def _hear(self, data: bytes, sender: SocketAddress) -> None:
        raise NotImplementedError

    def _send_to(self, data: bytes, address: SocketAddress) -> None:
        try:
            if self._socket is not None:
                self._socket.sendto(data, address)
                self.bytes_sent += len(data)
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.dropped += 1
        if not isinstance(error, BlockingIOError):
            self.problem = str(error)


class UdpServerEndpoint(UdpEndpoint):
    """Listens; sends to everyone that it has heard from lately, and what is meant for one system to that one alone."""

    def __init__(self, url: str, loop: asyncio.AbstractEventLoop, on_data: Callable[[bytes], None]) -> None:
        super().__init__(url, loop, on_data)
        self.strangers_refused = 0
        """Datagrams of those for whom there was no room."""
        self._heard_s: dict[SocketAddress, float] = {}
        self._looked_s = 0.0
        self._routes = Routes()

    @classmethod
    async def open(
        cls, url: str, loop: asyncio.AbstractEventLoop, on_data: Callable[[bytes], None], host: str, port: int
    ) -> UdpServerEndpoint:
        """Binds the port.

        Raises:
            Refused: the port is in use or not allowed, or the host is none of ours.
        """
        family, address = await resolve(url, loop, host, port, socket.SOCK_DGRAM)
        opened = socket.socket(family, socket.SOCK_DGRAM)
        try:
            opened.bind(address)
        except OSError as error:
            opened.close()
            raise Refused(bind_failure(url, port, error)) from None
        endpoint = cls(url, loop, on_data)
        endpoint._start(opened)
        return endpoint

    @property
    def peers(self) -> list[SocketAddress]:
        """Who is sent to: the addresses heard from lately."""
        self._forget_silent(self._loop.time())
        return list(self._heard_s)

    @property
    def is_connected(self) -> bool:
        """Whether somebody has been heard lately."""
        return bool(self.peers)

    def send(self, data: bytes) -> None:
        """Sends one datagram to each peer that it is for."""
        heard_s = self._heard_s
        peers = tuple(heard_s) if len(heard_s) <= 1 else self._routes.ways(tuple(heard_s), data)
        for peer in peers:
            self._send_to(data, peer)
        if (now_s := self._loop.time()) > self._looked_s + LOOK_AGAIN_S:
            self._forget_silent(now_s)

    def _forget_silent(self, now_s: float) -> None:
        self._looked_s = now_s
        if self._is_heard and self._sender in self._heard_s:
            self._heard_s[self._sender], self._is_heard = now_s, False
        silent = [peer for peer, heard_s in self._heard_s.items() if heard_s < now_s - PEER_EXPIRES_S]
        for peer in silent:
            del self._heard_s[peer]
            self._routes.forget(peer)
            if peer == self._sender:
                self._sender = None

    def _hear(self, data: bytes, sender: SocketAddress) -> None:
        if sender not in self._heard_s and not self._admits(sender, data):
            return
        if self._is_heard and self._sender is not None:
            self._heard_s[self._sender], self._is_heard = self._loop.time(), False
        self._sender = sender
        self._on_data(data)
        self.bytes_received += len(data)
        self._routes.learn(sender, data)
        self._heard_s[sender] = self._loop.time()

    def _admits(self, sender: SocketAddress, data: bytes) -> bool:
        """Makes room for a stranger."""
        if len(self._heard_s) >= MOST_PEERS:
            self._forget_silent(self._loop.time())
            if len(self._heard_s) >= MOST_PEERS:
                self.strangers_refused += 1
                return False
        self._heard_s[sender] = self._loop.time()
        self._routes.learn(sender, data)
        return True


class UdpClientEndpoint(UdpEndpoint):
    """Sends to one address; hears only that host, whichever of its ports it answers from."""

    def __init__(
        self,
        url: str,
        loop: asyncio.AbstractEventLoop,
        on_data: Callable[[bytes], None],
        address: SocketAddress,
    ) -> None:
        super().__init__(url, loop, on_data)
        self._address = address

    @classmethod
    async def open(
        cls, url: str, loop: asyncio.AbstractEventLoop, on_data: Callable[[bytes], None], host: str, port: int
    ) -> UdpClientEndpoint:
        """Finds the host's address.

        Raises:
            Refused: the host has none.
        """
        family, address = await resolve(url, loop, host, port, socket.SOCK_DGRAM)
        opened = socket.socket(family, socket.SOCK_DGRAM)
        opened.bind(("::" if family == socket.AF_INET6 else "0.0.0.0", 0))
        endpoint = cls(url, loop, on_data, address)
        endpoint._start(opened)
        return endpoint

    @property
    def is_connected(self) -> bool:
        """Whether it is open; whether somebody is there, UDP does not say."""
        return self._socket is not None

    def send(self, data: bytes) -> None:
        """Sends one datagram."""
        try:
            if self._socket is not None:
                self._socket.sendto(data, self._address)
                self.bytes_sent += len(data)
        except OSError as error:
            self._fail(error)

    def _hear(self, data: bytes, sender: SocketAddress) -> None:
        if sender[0] == self._address[0]:
            self._sender = sender
            self._on_data(data)
            self.bytes_received += len(data)


def enlarge(opened: socket.socket, size: int) -> None:
    """Gives a socket room for what comes while nobody reads: beyond the system's limit where we may, else up to it."""
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
