"""MAVLink over TCP: a server for several clients, and a client that reconnects."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Callable
from typing import Final

from gloc3.errors import Refused
from gloc3.mavlink.codec import Parser
from gloc3.mavlink.transport.udp import bind_failure, resolve

WRITE_BUFFER_BYTES: Final = 1 << 16
"""Unread data of a slow peer beyond which frames for it are dropped, bytes; stale ones are useless."""
RECONNECT_S: Final = 1.0
MOST_CLIENTS: Final = 16


def _text(error: Exception) -> str:
    """What is the matter with a connection, in the system's words and without its addresses."""
    number = getattr(error, "errno", None) or 0
    return os.strerror(number).lower() if number > 0 else str(getattr(error, "strerror", None) or error)


class _TcpEndpoint:
    """What both have in common."""

    intruder = ""

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

    def _write(self, transport: asyncio.Transport, data: bytes) -> None:
        if transport.is_closing() or transport.get_write_buffer_size() > WRITE_BUFFER_BYTES:
            self.dropped += 1
            return
        transport.write(data)
        self.bytes_sent += len(data)


class _Connection(asyncio.Protocol):
    """One connection; reports its events to its endpoint."""

    def __init__(self, endpoint: TcpServerEndpoint | TcpClientEndpoint) -> None:
        self._endpoint = endpoint
        self.parser = Parser()
        self.transport: asyncio.Transport
        self.host = ""
        """Of the other end."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        self.host = str(transport.get_extra_info("peername")[0])
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._endpoint.on_connected(self)

    def data_received(self, data: bytes) -> None:
        self._endpoint.on_received(self, data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._endpoint.on_lost(self, exc)


class TcpServerEndpoint(_TcpEndpoint):
    """Listens for clients. Their streams are kept apart: only whole frames are passed on."""

    is_datagram = True

    def __init__(self, url: str, loop: asyncio.AbstractEventLoop, on_data: Callable[[bytes], None]) -> None:
        super().__init__(url, loop, on_data)
        self._clients: list[_Connection] = []
        self._server: asyncio.Server | None = None

    @classmethod
    async def open(
        cls, url: str, loop: asyncio.AbstractEventLoop, on_data: Callable[[bytes], None], host: str, port: int
    ) -> TcpServerEndpoint:
        """Binds the port.

        Raises:
            Refused: the port is in use or not allowed, or the host is not an address of this computer.
        """
        family, address = await resolve(url, loop, host, port, socket.SOCK_STREAM)
        endpoint = cls(url, loop, on_data)
        try:
            endpoint._server = await loop.create_server(
                lambda: _Connection(endpoint), address[0], port, family=family, backlog=MOST_CLIENTS
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

    def send(self, data: bytes) -> None:
        """Sends to each client."""
        for client in self._clients:
            self._write(client.transport, data)

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
        """A client came."""
        if self._is_closed or len(self._clients) >= MOST_CLIENTS:
            self.problem = f"more than {MOST_CLIENTS} clients"
            connection.transport.abort()
        else:
            self._clients.append(connection)

    def on_received(self, connection: _Connection, data: bytes) -> None:
        """A client sent something."""
        self.bytes_received += len(data)
        frames = connection.parser.receive(data)
        if frames and not self._is_closed:
            self.origin = connection.host
            self._on_data(b"".join(frame.raw for frame in frames))

    def on_lost(self, connection: _Connection, error: Exception | None) -> None:
        """A client went."""
        if error is not None:
            self.problem = _text(error)
        if connection in self._clients:
            self._clients.remove(connection)


class TcpClientEndpoint(_TcpEndpoint):
    """Connects to a server, and tries again each second while there is none."""

    is_datagram = False
    local_port = None

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
            self._write(self._connection.transport, data)

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
            await self._loop.create_connection(lambda: _Connection(self), self._host, self._port)
        except OSError as error:
            self._retry(_text(error))

    def _retry(self, reason: str) -> None:
        self.problem = reason
        if not self._is_closed:
            self._again = self._loop.call_later(RECONNECT_S, self._begin)
