"""Serves the simulated Doppler velocity log over TCP in the protocols of real devices."""

import asyncio
import re
from collections.abc import Callable, Mapping
from math import cos
from typing import Final, NamedTuple

import msgspec

from gloc3.errors import Refused, nearest
from gloc3.mavlink.transport.endpoints import parse_url
from gloc3.messages.perception import BottomVelocity
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors.dvl import BEAM_RAD, RATE_HZ, DvlModel
from gloc3_sitl.vehicles.line_server import LineServer, ServerAddress
from gloc3_sitl.vehicles.scene import Scene

MOST_PORT: Final = 65535
EXAMPLE: Final = "a50://127.0.0.1:16171"


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


class DvlServer(LineServer):
    """Sends the velocity over the floor to every client at the device's rate.

    Args:
        scene: the vehicle.
        loop: event loop whose clock is used.
        seed: of noise and constant errors.
        address: address to listen on; port 0 picks a free one.
    """

    def __init__(self, scene: Scene, loop: asyncio.AbstractEventLoop, seed: int, address: DvlAddress) -> None:
        model, encode = DvlModel(seed), WIRES[address.wire]

        def lines(truth: Truth) -> bytes:
            return encode(model.measure(truth), truth.t_s)

        super().__init__(scene, loop, RATE_HZ, lines, ServerAddress("--dvl", address.wire, address.host, address.port))


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
