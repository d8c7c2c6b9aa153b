"""The Doppler velocity log over real sockets: the simulation serves it, and the onboard process's own source reads it."""

import asyncio
from typing import Final

import msgspec
import pytest

from gloc3.errors import Refused
from gloc3_onboard.sensors.registry import parse_source
from gloc3_onboard.sensors.sources.dvl import DvlSource
from gloc3_sitl.physics.truth import Truth
from gloc3_sitl.sensors.dvl_wire import WIRES
from gloc3_sitl.vehicles.dvl_server import DvlServer, read_dvl
from gloc3_sitl.vehicles.simulator import Simulator
from gloc3_sitl.world import World

SPEED_M_S = 0.8


class Bay:
    """An AUV that goes ahead at a speed, five metres below the surface of a bay that is twenty deep."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        simulator = Simulator(World.load("bay"), vehicle="auv", seed=3)
        simulator.body.place((0.0, 0.0, 5.0), velocity_ned_m_s=(SPEED_M_S, 0.0, 0.0))
        self.world: Final = simulator.world
        self._loop, self._truth = loop, simulator.truth()

    @property
    def now_s(self) -> float:
        return self._loop.time()

    def truth(self) -> Truth:
        return msgspec.structs.replace(self._truth, t_s=self.now_s)


@pytest.mark.parametrize("wire", sorted(WIRES))
async def test_what_the_simulation_serves_is_read_as_from_a_real_one(wire: str) -> None:
    loop = asyncio.get_running_loop()
    server = await DvlServer(Bay(loop), loop, 3, read_dvl(f"{wire}://127.0.0.1:0")).open()
    device = DvlSource("dvl", parse_source("dvl", server.url), loop.time)
    try:
        await asyncio.to_thread(device.open)
        async with asyncio.timeout(20.0):
            while (stamped := device.bottom_velocity()) is None or stamped.bottom.altitude_m == 0.0:
                await asyncio.sleep(0.02)
    finally:
        await asyncio.to_thread(device.close)
        await server.close()
    assert stamped.bottom.is_valid
    assert stamped.bottom.velocity_frd_m_s == pytest.approx((SPEED_M_S, 0.0, 0.0), abs=0.03)
    assert stamped.bottom.altitude_m == pytest.approx(15.0, abs=0.3)
    assert loop.time() - stamped.t_s < 5.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a50", "must be SCHEME://HOST:PORT, as a50://127.0.0.1:16171"),
        ("a50://127.0.0.1:99999", "must be SCHEME://HOST:PORT"),
        ("a51://127.0.0.1:1", "did you mean 'a50'"),
    ],
)
def test_an_address_that_is_none_is_refused_with_an_example(text: str, says: str) -> None:
    with pytest.raises(Refused, match=says):
        read_dvl(text)
