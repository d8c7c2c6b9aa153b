"""MAVLink over TCP: a server for several clients, and a client that reconnects."""

from __future__ import annotations

import asyncio
import os
import socket
from collections import deque
from collections.abc import Callable
from typing import Final

from gloc3.errors import Refused
from gloc3.mavlink.codec import Parser
from gloc3.mavlink.transport.pinning import AutopilotPins
from gloc3.mavlink.transport.udp import bind_failure, resolve

WAITING_FRAMES: Final = 1024
"""What may wait for a slow peer; beyond it the oldest are dropped."""
STALE_S: Final = 1.0
"""Age from which a frame that waits for a slow peer is dropped, s."""
UNSENT_BYTES: Final = 4096
"""What the kernel holds of them, bytes."""
DEAD_S: Final = 10.0
"""Time without an answer after which a connection is lost, s; slow modems need some seconds."""
PROBED_S: Final = 3.0
"""Silence after which the other end is probed, s."""
CONNECT_S: Final = 5.0
"""Time for the server to answer, s."""
NEXT_ADDRESS_S: Final = 1.0
"""Time after which a server's next address is tried as well, s."""
RECONNECT_S: Final = 1.0
MOST_CLIENTS: Final = 16
SILENT_S: Final = 5.0
"""Silence after which a client makes room for another, s."""


def _text(error: Exception) -> str:
    """What is the matter with a connection, in the system's words and without its addresses."""
    number = getattr(error, "errno", None) or 0
    return os.strerror(number).lower() if number > 0 else str(getattr(error, "strerror", None) or error)


class _TcpEndpoint:
    """What both have in common."""

    def __init__(self, url: str, loop: asyncio.AbstractEventLoop, on_data: Callable[[bytes], None]) -> None:
        self.url = url
        self.bytes_received = 0
        self.bytes_sent = 0
        self.dropped = 0
        self.problem = ""
        self.origin = ""
        self._loop = loop
        self._on_data = on_data
        self._is_closed = False


class _Connection(asyncio.Protocol):
    """One connection; reports its events to its endpoint. What its peer does not accept waits, and is dropped when stale."""

    def __init__(self, endpoint: TcpServerEndpoint | TcpClientEndpoint, now_s: Callable[[], float]) -> None:
        self._endpoint, self._now_s = endpoint, now_s
        self.parser = Parser()
        self.transport: asyncio.Transport
        self.host = self.name = ""
        """Of the other end; the second with its port."""
        self.received_s = now_s()
        """When it sent a frame last, or connected."""
        self._is_paused = False
        self._waiting: deque[tuple[float, bytes]] = deque()
        """Frames with the time at which they were queued."""

    def send(self, data: bytes) -> None:
        """Sends frames, at once or as soon as the peer accepts them."""
        if self._is_paused:
            if len(self._waiting) >= WAITING_FRAMES:
                self._waiting.popleft()
                self._endpoint.dropped += 1
            self._waiting.append((self._now_s(), data))
        elif self.transport.is_closing():
            self._endpoint.dropped += 1
        else:
            self.transport.write(data)
            self._endpoint.bytes_sent += len(data)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        self.host, port, *_ = transport.get_extra_info("peername")
        self.name = f"{self.host}:{port}"
        transport.set_write_buffer_limits(0)
        _set_options(transport.get_extra_info("socket"))
        self._endpoint.on_connected(self)

    def pause_writing(self) -> None:
        self._is_paused = True

    def resume_writing(self) -> None:
        self._is_paused = False
        while self._waiting and not self._is_paused:
            queued_s, data = self._waiting.popleft()
            if self._now_s() - queued_s > STALE_S:
                self._endpoint.dropped += 1
            else:
                self.send(data)

    def data_received(self, data: bytes) -> None:
        self._endpoint.on_received(self, data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._endpoint.dropped += len(self._waiting)
        self._endpoint.on_lost(self, exc)


def _set_options(opened: socket.socket) -> None:
    """Has the kernel send at once, hold little, and notice a dead peer, as far as the system can."""
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    values = {
        "TCP_NODELAY": 1,
        "TCP_NOTSENT_LOWAT": UNSENT_BYTES,
        "TCP_USER_TIMEOUT": round(DEAD_S * 1e3),
        "TCP_KEEPIDLE": round(PROBED_S),
        "TCP_KEEPINTVL": round(PROBED_S),
    }
    for name, value in values.items():
        if hasattr(socket, name):
            opened.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


class TcpServerEndpoint(_TcpEndpoint):
    """Listens for clients. Their streams are kept apart: only whole frames are passed on."""

    is_datagram = True

    def __init__(
        self,
        url: str,
        loop: asyncio.AbstractEventLoop,
        on_data: Callable[[bytes], None],
        *,
        pins_autopilot: bool = False,
    ) -> None:
        super().__init__(url, loop, on_data)
        self._pins = AutopilotPins() if pins_autopilot else None
        self._clients: list[_Connection] = []
        self._server: asyncio.Server | None = None

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
    ) -> TcpServerEndpoint:
        """Binds the port; `pins_autopilot` is that of `UdpServerEndpoint.open`.

        Raises:
            Refused: the port is in use or not allowed, or the host is not an address of this computer.
        """
        family, address = await resolve(url, loop, host, port, socket.SOCK_STREAM)
        endpoint = cls(url, loop, on_data, pins_autopilot=pins_autopilot)
        try:
            endpoint._server = await loop.create_server(
                lambda: _Connection(endpoint, loop.time), address[0], port, family=family, backlog=MOST_CLIENTS
            )
        except OSError as error:
            raise Refused(bind_failure(url, port, error)) from None
        return endpoint

    @property
    def local_port(self) -> int | None:
        """The port that it listens on."""
        return None if self._server is None else int(self._server.sockets[0].getsockname()[1])

    @property
    def is_connected(self) -> bool:
        """Whether there is a client."""
        return bool(self._clients)

    @property
    def intruder(self) -> str:
        """The recent client that claims the id of another client's autopilot; empty without one."""
        return "" if self._pins is None else self._pins.intruder(self._loop.time())

    def send(self, data: bytes) -> None:
        """Sends to each client."""
        for client in self._clients:
            client.send(data)

    async def close(self) -> None:
        """Closes the port and all connections."""
        self._is_closed = True
        if self._server is not None:
            self._server.close()
            self._server = None
        for client in list(self._clients):
            client.transport.abort()
        self._clients.clear()

    def on_connected(self, connection: _Connection) -> None:
        """A client came; the one that has been silent for longest makes room for it."""
        if len(self._clients) >= MOST_CLIENTS:
            silent = min(self._clients, key=lambda client: client.received_s)
            if self._loop.time() - silent.received_s > SILENT_S:
                self._clients.remove(silent)
                silent.transport.abort()
        if self._is_closed or len(self._clients) >= MOST_CLIENTS:
            self.problem = f"more than {MOST_CLIENTS} clients"
            connection.transport.abort()
        else:
            self._clients.append(connection)

    def on_received(self, connection: _Connection, data: bytes) -> None:
        """A client sent something."""
        self.bytes_received += len(data)
        frames = connection.parser.receive(data)
        if frames:
            connection.received_s = now_s = self._loop.time()
        if frames and self._pins is not None:
            who = [(frame.system, frame.component) for frame in frames]
            is_kept = [not self._pins.is_intruder(one, connection, connection.name, now_s) for one in who]
            self.dropped += is_kept.count(False)
            frames = [frame for frame, kept in zip(frames, is_kept, strict=True) if kept]
        if frames and not self._is_closed:
            self.origin = connection.host
            self._on_data(b"".join(frame.raw for frame in frames))

    def on_lost(self, connection: _Connection, error: Exception | None) -> None:
        """A client went."""
        if self._pins is not None:
            self._pins.release(connection)
        if error is not None:
            self.problem = _text(error)
        if connection in self._clients:
            self._clients.remove(connection)


class TcpClientEndpoint(_TcpEndpoint):
    """Connects to a server, and tries again each second while there is none."""

    is_datagram = False
    local_port = None
    intruder = ""

    def __init__(
        self, url: str, loop: asyncio.AbstractEventLoop, on_data: Callable[[bytes], None], host: str, port: int
    ) -> None:
        super().__init__(url, loop, on_data)
        self._host, self._port = host, port
        self._connection: _Connection | None = None
        self._attempt: asyncio.Task[None] | None = None
        self._again: asyncio.TimerHandle | None = None
        self._begin()

    @property
    def is_connected(self) -> bool:
        """Whether the connection is established."""
        return self._connection is not None

    def send(self, data: bytes) -> None:
        """Sends, or drops while there is no connection."""
        if self._connection is None:
            self.dropped += 1
        else:
            self._connection.send(data)

    async def close(self) -> None:
        """Closes the connection and stops reconnecting."""
        self._is_closed = True
        if self._again is not None:
            self._again.cancel()
        if self._attempt is not None and not self._attempt.done():
            self._attempt.cancel()
            await asyncio.wait([self._attempt])
        if self._connection is not None:
            self._connection.transport.abort()
            self._connection = None

    def on_connected(self, connection: _Connection) -> None:
        """The server answered."""
        self.problem = ""
        self._connection = connection

    def on_received(self, connection: _Connection, data: bytes) -> None:
        """The server sent something."""
        if not self._is_closed:
            self.bytes_received += len(data)
            self._on_data(data)

    def on_lost(self, connection: _Connection, error: Exception | None) -> None:
        """Handles a lost connection: reconnects."""
        self._connection = None
        self._retry("the connection was closed" if error is None else _text(error))

    def _begin(self) -> None:
        self._attempt = self._loop.create_task(self._connect())

    async def _connect(self) -> None:
        try:
            async with asyncio.timeout(CONNECT_S):
                await self._loop.create_connection(
                    lambda: _Connection(self, self._loop.time),
                    self._host,
                    self._port,
                    happy_eyeballs_delay=NEXT_ADDRESS_S,
                )
        except OSError as error:
            if self._connection is None:  # else it was made at the last moment, and is about to be lost
                self._retry(_text(error) or f"no answer within {CONNECT_S:g} s")

    def _retry(self, reason: str) -> None:
        self.problem = reason
        if not self._is_closed:
            self._again = self._loop.call_later(RECONNECT_S, self._begin)
