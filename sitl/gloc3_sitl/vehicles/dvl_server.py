"""Serves the simulated Doppler velocity log over TCP, as the real ones serve theirs."""

import asyncio
import re
from typing import Final, NamedTuple, Self

from gloc3.errors import Refused, nearest
from gloc3_sitl.sensors.dvl import RATE_HZ, DvlModel
from gloc3_sitl.sensors.dvl_wire import WIRES
from gloc3_sitl.vehicles.scene import Scene

MOST_CLIENTS: Final = 8
MOST_PORT: Final = 65535
EXAMPLE: Final = "a50://127.0.0.1:16171"
_BACKLOG_BYTES: Final = 16_384
"""A client that is so far behind misses lines."""
_LOOK_EVERY_S: Final = 0.01


class DvlAddress(NamedTuple):
    """Where it listens, and what it speaks there."""

    wire: str
    """A key of `WIRES`."""
    host: str
    port: int


def read_dvl(text: str) -> DvlAddress:
    """Reads `a50://HOST:PORT` or `pd6://HOST:PORT`.

    Raises:
        Refused: it is none.
    """
    match = re.fullmatch(r"(?P<wire>\w+)://(?P<host>[^:/]+):(?P<port>\d{1,5})", text)
    if match is None or int(match["port"]) > MOST_PORT:
        raise Refused(f"--dvl {text!r} must be SCHEME://HOST:PORT, as {EXAMPLE}")
    if match["wire"] not in WIRES:
        raise Refused(f"--dvl {text!r}: {nearest(match['wire'], list(WIRES))}")
    return DvlAddress(match["wire"], match["host"], int(match["port"]))


class DvlServer:
    """Tells every client the velocity over the floor, at the device's rate, whatever it sends.

    Args:
        scene: the vehicle.
        loop: whose time it looks by.
        seed: of noise and constant errors.
        address: where it listens; port 0 is any.
    """

    def __init__(self, scene: Scene, loop: asyncio.AbstractEventLoop, seed: int, address: DvlAddress) -> None:
        self._scene, self._loop, self._address = scene, loop, address
        self._model = DvlModel(seed)
        self._encode = WIRES[address.wire]
        self._slot = -1
        self._clients: set[asyncio.StreamWriter] = set()
        self._server: asyncio.Server | None = None
        self._timer: asyncio.TimerHandle | None = None

    @property
    def url(self) -> str:
        """The source that reads it."""
        assert self._server is not None
        return f"{self._address.wire}://{self._address.host}:{self._server.sockets[0].getsockname()[1]}"

    async def open(self) -> Self:
        """Listens.

        Raises:
            Refused: the address cannot be had.
        """
        _, host, port = self._address
        try:
            self._server = await asyncio.start_server(self._connected, host, port)
        except OSError as error:
            raise Refused(f"--dvl {host}:{port}: {error.strerror}") from error
        self._tick()
        return self

    async def close(self) -> None:
        """Serves no more."""
        if self._timer is not None:
            self._timer.cancel()
        for client in self._clients:
            client.close()
        if self._server is not None:
            self._server.close()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Takes a client, and nothing of what it sends."""
        del reader
        if len(self._clients) >= MOST_CLIENTS:
            writer.close()
        else:
            self._clients.add(writer)

    def _tick(self) -> None:
        self._timer = self._loop.call_later(_LOOK_EVERY_S, self._tick)
        slot = int(self._scene.now_s * RATE_HZ + 1e-6)
        if slot == self._slot:
            return
        self._slot = slot
        truth = self._scene.truth()
        said = self._encode(self._model.measure(truth), truth.t_s)
        self._clients = {client for client in self._clients if not client.is_closing()}
        for client in self._clients:
            if client.transport.get_write_buffer_size() < _BACKLOG_BYTES:
                client.write(said)
