"""MAVLink over UDP: a listener that answers everyone it has heard from, and a sender to one address."""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import Callable
from contextlib import suppress
from random import SystemRandom
from typing import Final

from gloc3.errors import Gloc3Error, Refused
from gloc3.mavlink.services.compiling import COMPILING
from gloc3.mavlink.services.direct_line import (
    AT_ONCE,
    LARGEST_DATAGRAM_BYTES,
    DirectLine,
    Passer,
    SocketAddress,
    connect,
    source_towards,
)
from gloc3.mavlink.services.fast_line import Outgoing
from gloc3.mavlink.services.peer_routes import Routes

RECEIVE_BUFFER_BYTES: Final = 1 << 22
"""The kernel keeps here what comes while nobody reads: half a second of 10,000 datagrams a second, where it lets us."""
_RCVBUFFORCE: Final = 33
"""SO_RCVBUFFORCE of Linux, which the socket module does not name."""
DATAGRAMS_AT_ONCE: Final = 256
"""After so many the rest of the process has its turn."""
MOST_PEERS: Final = 128
MOST_LINES: Final = 8
"""So many peers of a port have a direct line, which is a thread; the others are heard all the same."""
LOOK_AGAIN_S: Final = 1.0
"""So often at most the silent ones are looked for."""
PEER_EXPIRES_S: Final = 30.0
"""Who has said nothing for so long is not sent to any more, and makes room for another."""
_RANDOM: Final = SystemRandom()


class UdpEndpoint:
    """What both have in common: a socket that never blocks, read until it is empty, and direct lines where they are wanted."""

    is_datagram = True

    def __init__(self, url: str, loop: asyncio.AbstractEventLoop, on_data: Callable[[bytes], None]) -> None:
        self.url = url
        self.bytes_sent = 0
        self.dropped = 0
        self.problem = ""
        self._loop = loop
        self._on_data = on_data
        self._heard_bytes = 0
        self._socket: socket.socket | None = None
        self._lines: dict[SocketAddress, DirectLine] = {}
        self._make_passer: Callable[[], Passer] | None = None
        self._passed: Callable[[bytes], None] | None = None
        self._changed: Callable[[], None] = lambda: None

    @property
    def bytes_received(self) -> int:
        """What has come from all."""
        return self._heard_bytes + sum(line.bytes_passed for line in tuple(self._lines.values()))

    @property
    def local_port(self) -> int | None:
        """The port that the socket has."""
        return None if self._socket is None else int(self._socket.getsockname()[1])

    def go_direct(
        self,
        make_passer: Callable[[], Passer],
        passed: Callable[[bytes], None] | None,
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        """Wants a direct line to each peer, as long as they are few.

        Args:
            make_passer: makes what passes on a line's datagrams by itself.
            passed: told of each datagram that was passed on so; None where nobody wants to know.
            changed: told before a way out is closed, and when there is another.
        """
        self._make_passer, self._passed, self._changed = make_passer, passed, changed

    def post(self, data: bytes) -> None:
        """Sends as `send` does, from any thread."""
        raise NotImplementedError

    def outgoing(self) -> list[Outgoing] | None:
        """The lines by which `post` sends what is for all; None while some of it goes otherwise."""
        raise NotImplementedError

    def tend(self) -> None:
        """To be called now and then where lines are wanted: settles what they pass on, and gives up those that lead no more."""
        for line in tuple(self._lines.values()):
            self._hasten(line)
            line.passer.settle(self._loop.time())
            if not line.is_alive or source_towards(line.peer, line.opened.family) != line.source:
                self._end_line(line.peer)

    async def close(self) -> None:
        """Closes the sockets."""
        for peer in tuple(self._lines):
            self._end_line(peer)
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
        left = DATAGRAMS_AT_ONCE
        while left and self._socket is not None:  # who is told may close it
            left -= 1
            try:
                data, sender = self._socket.recvfrom(LARGEST_DATAGRAM_BYTES)
            except (BlockingIOError, InterruptedError):
                return
            except OSError as error:  # nobody listens there (any more); the next one may be heard again
                self.problem = str(error)
                continue
            self._hear(data, sender)

    def _hear(self, data: bytes, sender: SocketAddress) -> None:
        raise NotImplementedError

    def _open_line(self, peer: SocketAddress) -> None:
        """Opens a direct line to a peer, where that is wanted and can be."""
        if self._make_passer is None or self._socket is None or peer in self._lines or len(self._lines) >= MOST_LINES:
            return
        found = connect(self._socket, (line.opened for line in self._lines.values()), peer)
        if found is None:
            return
        opened, strays = found
        enlarge(opened, RECEIVE_BUFFER_BYTES)
        line = DirectLine(peer, opened, self._loop, self._make_passer(), self._hear, self._passed)
        self._hasten(line)
        self._lines[peer] = line
        self._changed()
        self._read()  # what came before
        for data, sender in strays:
            self._hear(data, sender)
        line.begin()

    def _end_line(self, peer: SocketAddress) -> None:
        line = self._lines.pop(peer, None)
        if line is not None:
            self._changed()
            line.close()
            self._heard_bytes += line.bytes_passed

    def _hasten(self, line: DirectLine) -> None:
        """Has a compiled loop receive on a line, once there is one; it is wanted as soon as a line passes something on."""
        if line.is_fast:
            return
        if COMPILING.loop is not None:
            line.hasten(COMPILING.loop, _RANDOM.getrandbits(64))
        elif line.bytes_passed:
            COMPILING.begin(self._not_compiled)

    def _not_compiled(self, error: BaseException) -> None:
        """Tells, from another thread and in a line, that lines stay as they are."""
        why = str(error) if isinstance(error, Gloc3Error) else f"{type(error).__name__}: {error}"
        context = {"message": f"direct lines are not compiled, and work on as without gloc3[fast]: {why}"}
        with suppress(RuntimeError):  # the loop is closed: nobody is there to be told
            self._loop.call_soon_threadsafe(self._loop.call_exception_handler, context)

    def _sent(self, size: int, dropped: int, problem: str) -> None:
        """Counts what compiled lines have sent here."""
        self.bytes_sent += size
        self.dropped += dropped
        self.problem = problem or self.problem

    def _post_to(self, data: bytes, peer: SocketAddress) -> None:
        """Sends to one peer, from any thread; of what is counted at the same moment by two of them one may be missed."""
        line = self._lines.get(peer)
        try:
            if line is not None:
                try:
                    self.bytes_sent += line.opened.send(data, AT_ONCE)
                except ConnectionRefusedError:  # tells of what was sent before: this has not been tried yet
                    self.bytes_sent += line.opened.send(data, AT_ONCE)
            elif self._socket is not None:
                self.bytes_sent += self._socket.sendto(data, peer)
        except OSError as error:
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
        self._passed_bytes: dict[SocketAddress, int] = {}
        """What had come by each line when it was looked last who is silent."""
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
        since_s = self._loop.time() - PEER_EXPIRES_S
        return any(heard_s >= since_s for heard_s in tuple(self._heard_s.values()))

    def send(self, data: bytes) -> None:
        """Sends one datagram to each peer that it is for."""
        self.post(data)
        if self._loop.time() > self._looked_s + LOOK_AGAIN_S:
            self._forget_silent(self._loop.time())

    def post(self, data: bytes) -> None:
        """The same, from any thread."""
        peers = tuple(self._heard_s)
        for peer in peers if len(peers) <= 1 else self._routes.ways(peers, data):
            self._post_to(data, peer)

    def outgoing(self) -> list[Outgoing] | None:
        """The lines of all peers, if each has one."""
        lines = [self._lines.get(peer) for peer in self._heard_s]
        found = [Outgoing(line.opened.fileno(), self._sent) for line in lines if line is not None]
        return found if len(found) == len(lines) else None

    def tend(self) -> None:
        """Forgets silent peers as well, and opens lines to those that have none."""
        super().tend()
        self._forget_silent(self._loop.time())
        for peer in tuple(self._heard_s):
            self._open_line(peer)

    def _forget_silent(self, now_s: float) -> None:
        self._looked_s = now_s
        for peer, line in self._lines.items():
            if line.bytes_passed != self._passed_bytes.get(peer, 0):
                self._heard_s[peer], self._passed_bytes[peer] = now_s, line.bytes_passed
        silent = [peer for peer, heard_s in self._heard_s.items() if heard_s < now_s - PEER_EXPIRES_S]
        if silent:
            self._changed()
        for peer in silent:
            self._end_line(peer)
            self._passed_bytes.pop(peer, None)
            self._heard_s.pop(peer, None)
            self._routes.forget(peer)

    def _hear(self, data: bytes, sender: SocketAddress) -> None:
        is_new = sender not in self._heard_s
        if is_new and not self._admits(sender, data):
            return
        self._on_data(data)
        self._heard_bytes += len(data)
        self._routes.learn(sender, data)
        self._heard_s[sender] = self._loop.time()
        if is_new:
            self._open_line(sender)

    def _admits(self, sender: SocketAddress, data: bytes) -> bool:
        """Makes room for a stranger."""
        if len(self._heard_s) >= MOST_PEERS:
            self._forget_silent(self._loop.time())
            if len(self._heard_s) >= MOST_PEERS:
                self.strangers_refused += 1
                return False
        self._heard_s[sender] = self._loop.time()
        self._routes.learn(sender, data)
        self._changed()
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
        self._line: DirectLine | None = None

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

    def go_direct(
        self,
        make_passer: Callable[[], Passer],
        passed: Callable[[bytes], None] | None,
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        """Has its line at once: it knows its peer."""
        super().go_direct(make_passer, passed, changed)
        self._open_line(self._address)

    def outgoing(self) -> list[Outgoing] | None:
        """Its line."""
        return None if self._line is None else [Outgoing(self._line.opened.fileno(), self._sent)]

    def tend(self) -> None:
        """Opens the line again as well, where it was given up."""
        super().tend()
        self._open_line(self._address)

    def send(self, data: bytes) -> None:
        """Sends one datagram."""
        self.post(data)

    def post(self, data: bytes) -> None:
        """The same, from any thread, and at first the shortest way."""
        line = self._line
        if line is None:
            self._post_to(data, self._address)
            return
        try:
            self.bytes_sent += line.opened.send(data, AT_ONCE)
        except OSError:  # also of what was sent before: this one has not left
            self._post_to(data, self._address)

    def _open_line(self, peer: SocketAddress) -> None:
        super()._open_line(peer)
        self._line = self._lines.get(peer)

    def _end_line(self, peer: SocketAddress) -> None:
        self._line = None
        super()._end_line(peer)

    def _hear(self, data: bytes, sender: SocketAddress) -> None:
        if sender[0] == self._address[0]:
            self._on_data(data)
            self._heard_bytes += len(data)


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
