"""Messages between a host's main process and its child processes, on the socket pair between them."""

import asyncio
import socket
from collections.abc import Callable
from typing import Final

import msgspec

from gloc3.errors import Gloc3Error
from gloc3.messages.readiness import SensorCondition
from gloc3_onboard.process.run_log import LogLimits

LARGEST: Final = 1 << 18
"""Bytes of a message; requests to components are smaller."""


class ChildSetup(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """First message to a child: its setup."""

    platform: str
    """The platform file."""
    host: str
    process: str
    endpoint: str
    """Where the main process listens."""
    logs: str
    """Folder of logs and pictures."""
    devices: tuple[str, ...]
    """Sources that differ from the platform file's, as NAME=URL."""
    parent: int
    """Process id of the main process."""
    offset_s: float
    """The platform's time minus this computer's."""
    log_limits: LogLimits
    lives: dict[str, str | None] | None
    """How each component comes back: faulty with that cause, or absent (None). None for the first start of all."""


class Pass(msgspec.Struct, frozen=True, tag=True):
    """To the child: a request to one of its components."""

    envelope: bytes


class ChildReport(msgspec.Struct, frozen=True, tag=True):
    """Periodic message to a child: state that it cannot observe."""

    offset_s: float


class EndChild(msgspec.Struct, frozen=True, tag=True):
    """To the child: its components have left, it may end."""


class ChildReady(msgspec.Struct, frozen=True, tag=True):
    """From the child: its components are there, and take requests."""


class Beat(msgspec.Struct, frozen=True, tag=True):
    """From the child: its loop turns."""

    sensors: list[SensorCondition] | None = None
    """None for: as before."""
    log_problem: str = ""


ToChild = ChildSetup | Pass | ChildReport | EndChild
FromChild = ChildReady | Beat

_ENCODER: Final = msgspec.msgpack.Encoder()


class Pipe:
    """One end of a message pipe; `heard` gets each message, and None when the other end closes.

    Args:
        end: one of a pair of SOCK_SEQPACKET sockets; closed by this object.
        expected: type of received messages.
        loop: calls `heard`.
        received: called with each message.
    """

    def __init__(
        self,
        end: socket.socket,
        expected: type[ToChild] | type[FromChild],
        loop: asyncio.AbstractEventLoop,
        received: Callable[[ToChild | FromChild | None], None],
    ) -> None:
        self._end, self._loop, self._received = end, loop, received
        self._decoder: msgspec.msgpack.Decoder[ToChild | FromChild] = msgspec.msgpack.Decoder(expected)
        end.setblocking(False)
        loop.add_reader(end.fileno(), self._read)

    def send(self, message: ToChild | FromChild) -> bool:
        """Sends a message; returns whether the other end had room for it."""
        try:
            self._end.send(_ENCODER.encode(message))
        except OSError:  # it is gone, as its reader or the end of the process will tell, or takes nothing
            return False
        return True

    def close(self) -> None:
        """Hears nothing any more."""
        if self._end.fileno() >= 0:
            self._loop.remove_reader(self._end.fileno())
            self._end.close()

    def _read(self) -> None:
        try:
            data = self._end.recv(LARGEST)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.close()
            self._received(None)
            return
        self._received(self._decoder.decode(data))


def socket_pair() -> tuple[socket.socket, socket.socket]:
    """Two ends that keep the boundaries of messages.

    Raises:
        Gloc3Error: this system has no such sockets.
    """
    kind = getattr(socket, "SOCK_SEQPACKET", None)
    if kind is None or not hasattr(socket, "AF_UNIX"):
        raise Gloc3Error("components in processes of their own need Linux")
    ends = socket.socketpair(socket.AF_UNIX, kind)
    for end in ends:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 2 * LARGEST)
    return ends


def first_message(end: socket.socket) -> ChildSetup | None:
    """The first message to a child; None if its parent has already ended. Blocks."""
    data = end.recv(LARGEST)
    return msgspec.msgpack.decode(data, type=ChildSetup) if data else None
