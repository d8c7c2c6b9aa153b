"""PX4's simulator interface on a TCP socket, in real time."""

import asyncio
import errno
import socket
from typing import Final

from gloc3.errors import Gloc3Error, Refused
from gloc3_sitl.firmware.px4 import Px4Bridge
from gloc3_sitl.firmware.real_time_pacer import RealTimePacer

DEFAULT_PORT: Final = 4560


class HilServer:
    """Accepts one PX4, and steps the vehicle for it.

    Args:
        bridge: the simulated vehicle.
        loop: event loop whose clock is used.
        speed: multiple of real time at which the flight is paced.
    """

    def __init__(self, bridge: Px4Bridge, loop: asyncio.AbstractEventLoop, speed: float = 1.0) -> None:
        self.failure: Gloc3Error | None = None
        """Why there are no steps any more."""
        self._bridge, self._loop = bridge, loop
        self._pace: Final = RealTimePacer(speed)
        self._server: asyncio.Server | None = None
        self._client: asyncio.Transport | None = None
        self._timer: asyncio.TimerHandle | None = None

    @property
    def port(self) -> int:
        """The port in use."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    @property
    def is_connected(self) -> bool:
        """Whether a PX4 is connected."""
        return self._client is not None

    @property
    def slips(self) -> int:
        """Number of times that the flight has fallen behind real time without catching up."""
        return self._pace.slips

    async def open(self, port: int) -> None:
        """Listens on loopback.

        Raises:
            Refused: the port is in use.
        """
        try:
            self._server = await self._loop.create_server(lambda: _Connection(self), "127.0.0.1", port)
        except OSError as error:
            reason = "in use by another program" if error.errno == errno.EADDRINUSE else error.strerror
            raise Refused(f"TCP port {port} for the firmware: {reason}") from error

    async def close(self) -> None:
        """Stops serving."""
        self._stop()
        if self._client is not None:
            self._client.abort()
        if self._server is not None:
            self._server.close()

    def connected(self, client: asyncio.Transport) -> None:
        """Handles a connection; a second PX4 is rejected."""
        if self._client is not None:
            client.abort()
            return
        self._client = client
        self._bridge.connected()
        self._turn()

    def received(self, client: asyncio.Transport, data: bytes) -> None:
        """Handles data from PX4, which may release the next step."""
        if client is self._client:
            self._bridge.receive(data)
            if self._timer is None:
                self._turn()

    def is_disconnected(self, client: asyncio.Transport) -> None:
        """Handles a disconnection; another PX4 may connect."""
        if client is self._client:
            self._client = None
            self._stop()

    def _stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _turn(self) -> None:
        """Makes the step that is due; while an answer is waited for there is no timer, and the answer turns again."""
        self._timer = None
        client, bridge = self._client, self._bridge
        if client is None or not bridge.is_due:
            return
        wait_s = self._pace.wait_s(self._loop.time(), bridge.now_s)
        if wait_s <= 0.0:
            try:
                client.write(bridge.step())
            except Gloc3Error as error:
                self.failure = error
                return
        self._timer = self._loop.call_later(max(0.0, wait_s), self._turn)


class _Connection(asyncio.Protocol):
    def __init__(self, server: HilServer) -> None:
        self._server = server
        self._transport: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Sends frames without delay (TCP_NODELAY)."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._server.connected(transport)

    def data_received(self, data: bytes) -> None:
        """Forwards to the connection."""
        self._server.received(self._transport, data)

    def connection_lost(self, error: Exception | None) -> None:
        """Forwards to the connection."""
        self._server.is_disconnected(self._transport)
