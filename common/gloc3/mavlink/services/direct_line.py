"""A direct line to one peer of a UDP port: a connected socket on the same port, and a thread that waits for that peer alone.

An event loop that waits for many sockets costs more than to pass on a MAVLink frame. Here the thread waits in the call that
receives, and passes on what it may by itself; all else, and what somebody wants to read, goes to the loop in its order. A
connected socket costs less as well: the system looks up the way once, and nobody makes or reads addresses.

Linux only: elsewhere two UDP sockets on one port do not share it so.
"""

from __future__ import annotations

import asyncio
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any, Final, Protocol, TypeAlias

from gloc3.component.guard import guard
from gloc3.mavlink.services.fast_line import FastLine, Loop

LARGEST_DATAGRAM_BYTES: Final = 65_535
MOST_STRAYS: Final = 256

SocketAddress: TypeAlias = tuple[Any, ...]


AT_ONCE: Final = int(socket.MSG_DONTWAIT)
"""For sending by a line's socket, which waits only when it receives."""


class Passer(Protocol):
    """Passes on by itself what it may."""

    def pass_on(self, data: bytes) -> bool:
        """Passes a datagram on, in the line's thread; False for what it knows no way for."""

    def learn(self, data: bytes, now_s: float) -> None:
        """Told of a datagram that it knew no way for, once that has been dealt with."""

    def settle(self, now_s: float) -> None:
        """Now and then, and at the end: counts what it has passed on."""

    def hasten(self, fast: FastLine) -> None:
        """A compiled loop receives from now on, and passes on what it may by itself."""

    def end(self) -> None:
        """Has the compiled loop pass on nothing any more; when this returns, it does not."""


class DirectLine:
    """One line. All but the thread's work happens in the loop's thread.

    Args:
        peer: whom it leads to.
        opened: the connected socket.
        loop: gets what the passer does not pass on.
        passer: the line's own.
        hear: takes a datagram that was not passed on.
        passed: told of each that was; None where nobody wants to know.
    """

    def __init__(
        self,
        peer: SocketAddress,
        opened: socket.socket,
        loop: asyncio.AbstractEventLoop,
        passer: Passer,
        hear: Callable[[bytes, SocketAddress], None],
        passed: Callable[[bytes], None] | None,
    ) -> None:
        self.peer: Final = peer
        self.passer: Final = passer
        self.opened: Final = opened
        """Sends to the peer, from any thread."""
        self.source: Final[str] = opened.getsockname()[0]
        """Our address, from which the peer is reached."""
        self._bytes_passed = 0
        """Counted by the thread alone."""
        self._fast: FastLine | None = None
        self._loop, self._hear, self._passed = loop, hear, passed
        self._order: Final = memoryview(bytearray(16)).cast("q")
        """How many datagrams the thread has left to the loop, and how many of them the loop has dealt with."""
        self._waiting: deque[tuple[bytes, bool]] = deque()
        """What the loop is to be told, and whether that was passed on."""
        self._is_told = self._is_closed = False
        self._thread = threading.Thread(target=self._serve, name=f"line to {peer[0]}:{peer[1]}", daemon=True)

    @property
    def is_alive(self) -> bool:
        """Whether somebody listens."""
        return self._thread.is_alive()

    @property
    def bytes_passed(self) -> int:
        """What it has passed on by itself."""
        return self._bytes_passed + (0 if self._fast is None else self._fast.bytes_passed)

    @property
    def is_fast(self) -> bool:
        """Whether a compiled loop receives."""
        return self._fast is not None

    def begin(self) -> None:
        """Listens from now on."""
        self._thread.start()

    def hasten(self, compiled: Loop, seed: int) -> None:
        """Has a compiled loop receive, from the next datagram but one on.

        Args:
            compiled: the loop.
            seed: 64 random bits.
        """
        fast = FastLine(compiled, self.opened.fileno(), self._order, is_wanted=self._passed is not None, seed=seed)
        self.passer.hasten(fast)
        self._fast = fast

    def close(self) -> None:
        """Ends the thread, and deals with what it has left."""
        self._is_closed = True
        self.passer.end()
        with suppress(OSError):
            self.opened.shutdown(socket.SHUT_RD)
        if self._thread.is_alive():
            self._thread.join()
        self.opened.close()
        self._tell()
        self.passer.settle(self._loop.time())

    def _serve(self) -> None:
        _, error = guard(self._listen)
        if error is not None:
            context = {"message": f"the {self._thread.name} failed", "exception": error}
            with suppress(RuntimeError):  # the loop is closed: nobody is there to be told
                self._loop.call_soon_threadsafe(self._loop.call_exception_handler, context)

    def _listen(self) -> None:
        room = bytearray(LARGEST_DATAGRAM_BYTES)  # asked for as `bytes` it would be had from the system each time
        came, order, pass_on, waiting = memoryview(room), self._order, self.passer.pass_on, self._waiting
        is_wanted = self._passed is not None
        while True:
            size = self._receive(room)
            if not size:
                if self._is_closed:  # and all that had come is read
                    return
                continue
            data, is_passed = bytes(came[: abs(size)]), size < 0
            if not is_passed and order[0] == order[1] and pass_on(data):
                is_passed = True
                self._bytes_passed += size
            if not is_passed:
                order[0] += 1
            elif not is_wanted:
                continue
            waiting.append((data, is_passed))
            if not self._is_told:
                self._is_told = True
                self._loop.call_soon_threadsafe(self._tell)

    def _receive(self, room: bytearray) -> int:
        """The size of the next datagram; negative if a compiled loop has passed it on; 0 for none."""
        if self._fast is not None:
            return self._fast.serve(room)
        try:
            return self.opened.recv_into(room)
        except OSError:  # nobody listens there (any more), as sending says too; the next one may be heard again
            return 0

    def _tell(self) -> None:
        """Deals with what waits."""
        self._is_told = False
        waiting = self._waiting
        while waiting:
            data, is_passed = waiting.popleft()
            if not is_passed:
                self._hear(data, self.peer)
                self.passer.learn(data, self._loop.time())
                self._order[1] += 1
            elif self._passed is not None:
                self._passed(data)


def connect(
    own: socket.socket, others: Iterable[socket.socket], peer: SocketAddress
) -> tuple[socket.socket, list[tuple[bytes, SocketAddress]]] | None:
    """A socket on the same port for one peer alone, and what came there from anybody meanwhile; None where that cannot be.

    Args:
        own: the port's own socket.
        others: all lines that it has already.
        peer: whom it is to lead to.
    """
    if sys.platform != "linux":
        return None
    line = socket.socket(own.family, socket.SOCK_DGRAM)
    strays: list[tuple[bytes, SocketAddress]] = []
    sharing = (own, *others, line)
    try:
        _share(sharing, True)
        line.bind(own.getsockname())
        line.connect(peer)
        with suppress(BlockingIOError):
            strays.extend(line.recvfrom(LARGEST_DATAGRAM_BYTES, socket.MSG_DONTWAIT) for _ in range(MOST_STRAYS))
    except OSError:
        line.close()
        return None
    finally:
        _share(sharing, False)
    return line, strays


def source_towards(peer: SocketAddress, family: socket.AddressFamily) -> str:
    """Our address from which a peer is reached now; empty if there is no way."""
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(peer)
        except OSError:
            return ""
        return str(probe.getsockname()[0])


def _share(sockets: Iterable[socket.socket], is_shared: bool) -> None:
    """Lets one more socket have the same port, or nobody."""
    for each in sockets:
        if each.fileno() >= 0:
            each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, is_shared)
