"""The companion dies in flight: the station, which hears the autopilot on a link of its own, sends it home.

The companion that comes back is told whose command that was.
"""

import asyncio
import os
import secrets
import signal
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.commands.programs import program

from gloc3.messages.command_interface import EmergencyVerb
from gloc3.messages.summaries import VehicleSummary
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.autopilot_desk import BY_ITSELF
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.missions.plans import read_plan
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_sitl.demo.demo import free_ports

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

MISSION = """\
mission: up and wait
frame: geo
on_failure: hold
on_link_loss: continue
on_pose_lost: land
tasks:
  up: {actions: {off: {take_off: {height_m: 4}}}}
  wait: {after: [up], actions: {there: {hold: {duration_s: 300}}}}
"""
PLACE = "-35.363261,149.165230,584,0"
"""Where the frames of the platform file begin."""


async def comes(is_so: Callable[[], bool], within_s: float = 60.0) -> None:
    async with asyncio.timeout(within_s):
        while not is_so():
            await asyncio.sleep(0.05)


@pytest.mark.parametrize("style", ["px4", "ardupilot"])
async def test_hold_return_and_land_go_to_the_autopilot_itself(style: str, tmp_path: Path) -> None:
    companion, station, direct = free_ports(3, socket.SOCK_DGRAM)
    (tmp_path / "mission.yaml").write_text(MISSION)
    vehicle = ("sitl", "--vehicle", "copter", "--autopilot", style, "--world", "open", f"--home={PLACE}")
    links = ("--link", f"companion=udpout://127.0.0.1:{companion}", "--link", f"station=udpout://127.0.0.1:{direct}")
    ends = ("--autopilot", f"udpin://127.0.0.1:{companion}", "--station", f"udpout://127.0.0.1:{station}")
    onboard = ("onboard", "copter", *ends, "--out", "out")
    with program(*vehicle, *links, folder=tmp_path), program(*onboard, folder=tmp_path) as process:
        ground = GroundStation(StationSetup(boot=secrets.randbits(32), system=255))
        try:
            await ground.open([f"udpin://127.0.0.1:{station}", f"udpin://127.0.0.1:{direct}"])
            desk, fleet = Desk(ground.station, services=ground.services), ground.station
            async with asyncio.timeout(60.0):
                name = await flights.await_platform(fleet, None)
            assert not await flights.await_ready(fleet, name)
            await flights.stream(fleet, name, read_plan(str(tmp_path / "mission.yaml"), "copter"))
            await flights.start(fleet, name, settles_s=60.0)

            def here() -> PlatformSnapshot:
                return fleet.fleet.platforms[name]

            def seen() -> VehicleSummary:
                vehicle = here().vehicle
                assert vehicle is not None
                return vehicle.value

            def waits() -> bool:
                mission = here().mission
                return mission is not None and mission.value.tasks.get("wait") == "running"

            def told() -> list[str]:
                return [event.text for event in fleet.fleet.events]

            await comes(waits)
            assert desk.autopilots.offers(here()) == ()
            assert not [text for text in told() if "another station" in text], "our own frames come back by the router"
            os.killpg(process.process.pid, signal.SIGKILL)
            await comes(lambda: desk.autopilots.is_its_own(here()), 20.0)
            assert Action.RETURN in desk.autopilots.offers(here())
            assert await desk.emergency(name, EmergencyVerb.HOLD), "\n".join(told()[-6:])
            assert BY_ITSELF in told()
            await comes(lambda: seen().mode in ("AUTO.LOITER", "BRAKE"))
            assert await desk.autopilots.act(name, Action.RETURN), told()
            await comes(lambda: seen().mode in ("AUTO.RTL", "RTL"))
            with program(*onboard, folder=tmp_path):
                await comes(lambda: here().is_known and not here().is_quiet_link(fleet.now_s()), 20.0)
                await comes(lambda: any("sent return to the autopilot" in text for text in told()))
                if seen().is_armed:
                    assert await desk.emergency(name, EmergencyVerb.LAND), told()
                await comes(lambda: not seen().is_armed)
        finally:
            await ground.close()
