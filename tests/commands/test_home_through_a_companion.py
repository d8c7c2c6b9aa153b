"""Home and rally points of a vehicle with a companion: the frames pass it, and only who is in control may move them."""

import asyncio
import secrets
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.commands.programs import program

from gloc3.errors import Refused
from gloc3.messages.frames import GeoPoint
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.service_jobs import ServiceKind
from gloc3_groundstation.station.snapshots import AutopilotSnapshot
from gloc3_sitl.demo.demo import free_ports

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

PLACE = "-35.363261,149.165230,584,0"
"""Where the frames of the platform file begin."""


async def comes(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(60.0):
        while not is_so():
            await asyncio.sleep(0.05)


async def test_home_and_rally_points_are_moved_by_the_station_in_control_alone(tmp_path: Path) -> None:
    companion, station = free_ports(2, socket.SOCK_DGRAM)
    vehicle = ("sitl", "--vehicle", "copter", "--autopilot", "ardupilot", "--world", "open", f"--home={PLACE}")
    ends = ("--autopilot", f"udpin://127.0.0.1:{companion}", "--station", f"udpout://127.0.0.1:{station}")
    with (
        program(*vehicle, "--link", f"companion=udpout://127.0.0.1:{companion}", folder=tmp_path),
        program("onboard", "copter", *ends, "--out", "out", folder=tmp_path),
    ):
        ground = GroundStation(StationSetup(boot=secrets.randbits(32), system=255))
        try:
            await ground.open([f"udpin://127.0.0.1:{station}"])
            desk, fleet = Desk(ground.station, services=ground.services), ground.station
            async with asyncio.timeout(60.0):
                name = await flights.await_platform(fleet, None)

            def autopilot() -> AutopilotSnapshot | None:
                return fleet.fleet.platforms[name].autopilot

            def home() -> tuple[float, float, float] | None:
                known = autopilot()
                return known.home_geo if known is not None else None

            await comes(lambda: home() is not None)
            before = home()
            assert before is not None
            north = GeoPoint(before[0] + 2e-5, before[1], before[2])
            services = desk.services.vehicle(name)
            with pytest.raises(Refused, match="nobody is in control"):
                await desk.autopilots.set_home(name, north)
            services.plans.upload_rally(((north[0], north[1], 20.0),))
            await comes(lambda: ServiceKind.PLANS in services.jobs.outcomes)
            assert "nobody is in control" in services.jobs.outcomes[ServiceKind.PLANS].text
            assert home() == before
            await flights.request_control(fleet, name)
            await desk.autopilots.set_home(name, north)
            await comes(lambda: home() == pytest.approx(north, abs=1e-6))
            services.plans.upload_rally(((north[0], north[1], 20.0),))
            await comes(lambda: services.plans.rally is not None)
            assert (
                services.jobs.outcomes[ServiceKind.PLANS].text == "1 rally point on the vehicle, read back and compared"
            )
        finally:
            await ground.close()
