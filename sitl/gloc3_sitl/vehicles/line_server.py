"""Serves simulated sensors over TCP as devices that send lines and read nothing; the world's fields are such."""

import asyncio
from collections.abc import Callable
from typing import Final, NamedTuple, Self

from gloc3.errors import Refused
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.vehicles.scene import Scene
from gloc3_sitl.world.field_probe import RATE_HZ, field_lines

MOST_CLIENTS: Final = 8
_BACKLOG_BYTES: Final = 16_384
"""A client that is so far behind misses lines."""
_POLL_PERIOD_S: Final = 0.01


class ServerAddress(NamedTuple):
    """Where a server listens, and for what."""

    option: str
    """The option that asked for it, for messages."""
    scheme: str
    """Of the source that reads it."""
    host: str
    port: int
    """0 picks a free one."""


class LineServer:
    """Sends what a sensor measures to every client at the sensor's rate.

    Args:
        scene: the vehicle.
        loop: event loop whose clock is used.
        rate_hz: of the sensor.
        measure: measures and encodes; called at the rate, with or without clients.
        address: address to listen on.
    """

    def __init__(
        self,
        scene: Scene,
        loop: asyncio.AbstractEventLoop,
        rate_hz: float,
        measure: Callable[[Truth], bytes],
        address: ServerAddress,
    ) -> None:
        self._scene, self._loop, self._rate_hz, self._measure = scene, loop, rate_hz, measure
        self._address = address
        self._slot = -1
        self._clients: set[asyncio.StreamWriter] = set()
        self._server: asyncio.Server | None = None
        self._timer: asyncio.TimerHandle | None = None

    @property
    def url(self) -> str:
        """URL of the source that reads it."""
        assert self._server is not None
        return f"{self._address.scheme}://{self._address.host}:{self._server.sockets[0].getsockname()[1]}"

    async def open(self) -> Self:
        """Listens.

        Raises:
            Refused: the address cannot be had.
        """
        option, _, host, port = self._address
        try:
            self._server = await asyncio.start_server(self._connected, host, port)
        except OSError as error:
            raise Refused(f"{option} {host}:{port}: {error.strerror}") from error
        self._tick()
        return self

    async def close(self) -> None:
        """Stops serving."""
        if self._timer is not None:
            self._timer.cancel()
        for client in self._clients:
            client.close()
        if self._server is not None:
            self._server.close()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Accepts a client and ignores its input."""
        del reader
        if len(self._clients) >= MOST_CLIENTS:
            writer.close()
        else:
            self._clients.add(writer)

    def _tick(self) -> None:
        self._timer = self._loop.call_later(_POLL_PERIOD_S, self._tick)
        slot = int(self._scene.now_s * self._rate_hz + 1e-6)
        if slot == self._slot:
            return
        self._slot = slot
        text = self._measure(self._scene.truth())
        self._clients = {client for client in self._clients if not client.is_closing()}
        for client in self._clients:
            if client.transport.get_write_buffer_size() < _BACKLOG_BYTES:
                client.write(text)


def field_server(scene: Scene, loop: asyncio.AbstractEventLoop, seed: int, port: int) -> LineServer:
    """Serves all fields of the world on loopback, a line `NAME VALUE UNIT` for each.

    Raises:
        Refused: the world has no field.
    """
    if not scene.world.file.fields:
        raise Refused(f"--fields: the world {scene.world.name} has no fields; add fields: to a world file of yours")
    address = ServerAddress("--fields", "lines", "127.0.0.1", port)
    return LineServer(scene, loop, RATE_HZ, field_lines(scene.world, seed), address)
