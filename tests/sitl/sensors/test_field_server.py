"""The fields of a world over real sockets: the simulation serves them, and the onboard process's own source reads them."""

import asyncio
from pathlib import Path

import pytest
from tests.sitl.sensors.test_dvl_server import Bay

from gloc3.errors import Refused
from gloc3_onboard.sensors.registry import parse_source
from gloc3_onboard.sensors.sources.probe import LineProbe
from gloc3_sitl.vehicles.line_server import field_server
from gloc3_sitl.world import World

SALTY = """
world: salty
based_on: bay
fields:
  temperature: {unit: °C, background: 8}
  salinity: {unit: PSU, background: 35, sources: {spring: {position_m: [0, 0, -5], peak: -20, radius_m: 10}}}
"""


async def test_what_the_simulation_serves_is_read_as_from_a_real_probe(tmp_path: Path) -> None:
    loop = asyncio.get_running_loop()
    bay = Bay(loop)
    with pytest.raises(Refused, match="the world bay has no fields; add fields:"):
        field_server(bay, loop, 3, 0)
    (tmp_path / "salty.yaml").write_text(SALTY, encoding="utf-8")
    bay.world = World.load(str(tmp_path / "salty.yaml"))  # type: ignore[misc]
    server = await field_server(bay, loop, 3, 0).open()
    url = parse_source("salinity_probe", f"{server.url}#salinity")
    assert url.place.startswith("127.0.0.1:")
    device = LineProbe("salinity_probe", url, loop.time)
    try:
        await asyncio.to_thread(device.open)
        async with asyncio.timeout(20.0):
            while (reading := device.reading()) is None:
                await asyncio.sleep(0.02)
    finally:
        await asyncio.to_thread(device.close)
        await server.close()
    assert reading.value == pytest.approx(15.0, abs=0.1)
    assert loop.time() - reading.t_s < 5.0
