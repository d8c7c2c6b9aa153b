"""Serves the simulated Doppler velocity log over TCP in the protocols of real devices."""

import asyncio
import re
from collections.abc import Callable, Mapping
from math import cos
from typing import Final, NamedTuple, Self

import msgspec

from gloc3.errors import Refused, nearest
from gloc3.mavlink.transport.endpoints import parse_url
from gloc3.messages.perception import BottomVelocity
from gloc3_sitl.sensors.dvl import BEAM_RAD, RATE_HZ, DvlModel
from gloc3_sitl.vehicles.scene import Scene

MOST_CLIENTS: Final = 8
MOST_PORT: Final = 65535
EXAMPLE: Final = "a50://127.0.0.1:16171"
_BACKLOG_BYTES: Final = 16_384
"""A client that is so far behind misses lines."""
_POLL_PERIOD_S: Final = 0.01


class DvlAddress(NamedTuple):
    """Address and protocol of the server."""

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


def exposure(address: DvlAddress) -> str:
    """Warning about a server that other computers reach; empty for others."""
    if not parse_url(f"tcpin://{address.host}:{address.port}").is_open:
        return ""
    return f"{address.wire}://{address.host}:{address.port} is open to the network: anyone who reaches it can read it"


class DvlServer:
    """Sends the velocity over the floor to every client at the device's rate.

    Args:
        scene: the vehicle.
        loop: event loop whose clock is used.
        seed: of noise and constant errors.
        address: address to listen on; port 0 picks a free one.
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
        """URL of the source that reads it."""
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
        slot = int(self._scene.now_s * RATE_HZ + 1e-6)
        if slot == self._slot:
            return
        self._slot = slot
        truth = self._scene.truth()
        text = self._encode(self._model.measure(truth), truth.t_s)
        self._clients = {client for client in self._clients if not client.is_closing()}
        for client in self._clients:
            if client.transport.get_write_buffer_size() < _BACKLOG_BYTES:
                client.write(text)


UNLOCKED_FOM: Final = 2.0
"""Figure of merit that an A50 reports without bottom lock, m/s."""

Encode = Callable[[BottomVelocity, float], bytes]
"""Encodes a velocity and its time in seconds since the device was switched on."""


def a50_line(bottom: BottomVelocity, t_s: float) -> bytes:
    """One JSON object; stamps are microseconds since the device was switched on, as without a time server."""
    vx, vy, vz = bottom.velocity_frd_m_s
    fom = bottom.std_m_s if bottom.is_valid else UNLOCKED_FOM
    stamp_us, variance = round(t_s * 1e6), fom * fom
    reach_m = bottom.altitude_m / cos(BEAM_RAD)
    beams = [
        {"id": number, "velocity": 0.0, "distance": reach_m if bottom.is_valid else -1.0, "beam_valid": bottom.is_valid}
        for number in range(4)
    ]
    text = {
        "time": 1e3 / RATE_HZ,
        "vx": vx,
        "vy": vy,
        "vz": vz,
        "fom": fom,
        "covariance": [[variance, 0.0, 0.0], [0.0, variance, 0.0], [0.0, 0.0, variance]],
        "altitude": bottom.altitude_m if bottom.is_valid else -1.0,
        "transducers": beams,
        "velocity_valid": bottom.is_valid,
        "status": 0,
        "format": "json_v3.1",
        "type": "velocity",
        "time_of_validity": stamp_us,
        "time_of_transmission": stamp_us,
    }
    return msgspec.json.encode(text) + b"\r\n"


def pd6_lines(bottom: BottomVelocity, t_s: float) -> bytes:
    """Two lines of text; velocities to starboard, forward and from keel to mast; accumulated distances stay 0."""
    del t_s
    if not bottom.is_valid:
        return b":BS,-32768,-32768,-32768,V\r\n:BD,+00000,+00000,+00000,0000.00,000.00\r\n"
    ahead, right, down = (round(1e3 * part) for part in bottom.velocity_frd_m_s)
    velocity = f":BS,{right:+06d},{ahead:+06d},{-down:+06d},A"
    return f"{velocity}\r\n:BD,+00000,+00000,+00000,{bottom.altitude_m:07.2f},000.00\r\n".encode()


WIRES: Final[Mapping[str, Encode]] = {"a50": a50_line, "pd6": pd6_lines}
"""By the scheme of the source that reads it."""
