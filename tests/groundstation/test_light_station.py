"""What a station that joins no network loads: in a terminal, without one, in a script, and in a simulated flight."""

import subprocess
import sys
from typing import Final

import pytest

pytestmark = pytest.mark.sockets

UNUSED: Final = {
    "PIL": "pictures of a report",
    "aiohttp": "the pages of --web",
    "cryptography": "a network's certificates: it is a member of none",
    "cv2": "vision",
    "matplotlib": "plots",
    "mavsdk": "vehicles without a companion",
    "scipy": "laser odometry and pose fusion",
    "zenoh": "a network: it is a member of none",
}
"""Packages and what they are for."""
STATION: Final = """
import asyncio, sys
import {module}
from gloc3_groundstation.assembly import GroundStation, StationSetup, read_membership

async def watch():
    ground = GroundStation(StationSetup(boot=1, network=read_membership(None)))
    await ground.open(["udpin://127.0.0.1:0"])
    await ground.close()

asyncio.run(watch())
print(*sys.modules)
"""


@pytest.mark.parametrize(
    ("module", "more"),
    [
        ("gloc3_groundstation.tui.app", set()),
        ("gloc3_groundstation.cli.station, gloc3_groundstation.cli.headless", {"rich", "textual"}),
        ("gloc3_groundstation.api", {"rich", "textual"}),
        ("gloc3_sitl.flight.flight", {"rich", "textual"}),
    ],
)
def test_a_station_without_a_network_loads_only_what_it_uses(module: str, more: set[str]) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", STATION.format(module=module)], capture_output=True, text=True, timeout=900.0, check=True
    )
    loaded = ran.stdout.split()
    assert "gloc3_groundstation.links.links" in loaded
    assert {name.partition(".")[0] for name in loaded} & (UNUSED.keys() | more) == set()
