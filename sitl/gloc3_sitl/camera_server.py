"""Serves the simulated ground camera to companion processes on the same machine, as a TCP stream of frames."""

import asyncio
import errno
from typing import Final, Self

from gloc3.errors import Refused
from gloc3.frame_stream import GreyFrame, encode
from gloc3_sitl.simulator import Simulator
from gloc3_sitl.world.camera import Camera
from gloc3_sitl.world.rig import GROUND, GROUND_IMAGER

MOST_CLIENTS: Final = 4


class CameraServer:
    """Takes pictures at the camera's rate while somebody is connected; a client that is too slow misses frames."""

    def __init__(self, simulator: Simulator, loop: asyncio.AbstractEventLoop, seed: int, name: str = "ground") -> None:
        self._simulator, self._loop, self._name = simulator, loop, name
        self._camera = Camera(simulator.world, GROUND, GROUND_IMAGER, seed)
        self._clients: list[asyncio.StreamWriter] = []
        self._server: asyncio.Server | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._last_s = float("-inf")

    @property
    def port(self) -> int:
        """The port that it really has."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    async def open(self, port: int) -> Self:
        """Listens on loopback.

        Raises:
            Refused: the port is in use.
        """
        try:
            self._server = await asyncio.start_server(self._connected, "127.0.0.1", port)
        except OSError as error:
            reason = "it is in use by another program" if error.errno == errno.EADDRINUSE else error.strerror
            raise Refused(f"camera port {port}: {reason}") from error
        self._camera.capture(self._simulator.truth())  # the first picture takes long, and time does not run yet
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

    async def _connected(self, _reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self._clients) >= MOST_CLIENTS:
            writer.close()
        else:
            self._clients.append(writer)

    def _tick(self) -> None:
        self._timer = self._loop.call_later(0.02, self._tick)
        self._clients = [client for client in self._clients if not client.is_closing()]
        now_s = self._simulator.now_s
        if not self._clients or now_s - self._last_s < 1.0 / GROUND_IMAGER.rate_hz - 1e-6:
            return
        self._last_s = now_s
        photo = self._camera.capture(self._simulator.truth())
        height, width = photo.pixels.shape
        data = encode(GreyFrame(round(photo.t_s * 1e6), self._name, width, height, photo.pixels.tobytes()))
        for client in self._clients:
            if client.transport.get_write_buffer_size() < len(data):
                client.write(data)
