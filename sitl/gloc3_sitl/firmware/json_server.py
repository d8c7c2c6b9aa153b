"""ArduPilot's JSON interface on a UDP socket, in real time."""

import asyncio
import errno
import socket
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, Final, TypeAlias

from gloc3.errors import Gloc3Error, Refused
from gloc3_sitl.firmware.ardupilot import ArduPilotBridge
from gloc3_sitl.firmware.real_time_pacer import RealTimePacer

SocketAddress: TypeAlias = tuple[Any, ...]

DEFAULT_PORT: Final = 9002
_LARGEST: Final = 2048
_AT_ONCE: Final = 64
"""Packets handled before other tasks get a turn."""
_MOST_EARLY_S: Final = 0.004
"""Length of a burst of steps, s: a timer for each step would cost more than the step."""


class JsonServer:
    """Replies to the sender of each servo packet; packets that are early wait in the socket.

    Args:
        bridge: the simulated vehicle.
        loop: event loop whose clock is used.
        speed: multiple of real time at which the flight is paced.
    """

    def __init__(self, bridge: ArduPilotBridge, loop: asyncio.AbstractEventLoop, speed: float = 1.0) -> None:
        self.failure: Gloc3Error | None = None
        """Why nothing is answered any more."""
        self._bridge, self._loop = bridge, loop
        self._pace: Final = RealTimePacer(speed)
        self._timer: asyncio.TimerHandle | None = None
        self._socket: socket.socket | None = None

    @property
    def port(self) -> int:
        """The port in use."""
        assert self._socket is not None
        return int(self._socket.getsockname()[1])

    @property
    def is_connected(self) -> bool:
        """Whether a firmware has connected."""
        return not self._bridge.is_alone

    @property
    def slips(self) -> int:
        """Number of times that the flight has fallen behind real time without catching up."""
        return self._pace.slips

    async def open(self, port: int) -> None:
        """Listens on loopback.

        Raises:
            Refused: the port is in use.
        """
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            opened.bind(("127.0.0.1", port))
        except OSError as error:
            opened.close()
            reason = "in use by another program" if error.errno == errno.EADDRINUSE else error.strerror
            raise Refused(f"UDP port {port} for the firmware: {reason}") from error
        opened.setblocking(False)
        self._socket = opened
        self._loop.add_reader(opened, self._read)

    async def close(self) -> None:
        """Stops answering."""
        if self._timer is not None:
            self._timer.cancel()
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def _read(self) -> None:
        opened = self._socket
        assert opened is not None
        for data, sender in newest(opened):
            try:
                answer = self._bridge.receive(data, sender)
            except Gloc3Error as error:
                self.failure = error
                self._loop.remove_reader(opened)
                return
            if answer is None:
                continue
            with suppress(OSError):  # it asks again
                opened.sendto(answer, sender)
            wait_s = self._pace.wait_s(self._loop.time(), self._bridge.now_s)
            if wait_s > _MOST_EARLY_S and self._timer is None:
                self._loop.remove_reader(opened)
                self._timer = self._loop.call_later(wait_s, self._go_on)

    def _go_on(self) -> None:
        self._timer = None
        if self._socket is not None:
            self._loop.add_reader(self._socket, self._read)


def newest(opened: socket.socket) -> Iterator[tuple[bytes, SocketAddress]]:
    """Returns the packets in a non-blocking socket; of repeated ones, unanswered by then, only one."""
    before: tuple[bytes, SocketAddress] | None = None
    for _ in range(_AT_ONCE):
        try:
            packet = opened.recvfrom(_LARGEST)
        except (BlockingIOError, InterruptedError):
            break
        except OSError:  # who was answered is gone
            continue
        if before is not None and packet != before:
            yield before
        before = packet
    if before is not None:
        yield before
