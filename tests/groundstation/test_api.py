"""The station for scripts: its exceptions, without a vehicle; docs/examples are flown in tests/commands."""

import socket
from pathlib import Path

import pytest
from tests.groundstation.scripted_platform import ScriptedPlatform, refused

from gloc3.clock import run_virtual
from gloc3.exchange import LocalExchange
from gloc3.messages.command_interface import Control, Emergency, Steer, Verb
from gloc3.messages.summaries import ControlState
from gloc3_groundstation.api import NotHeard, Refused, ScriptStation, ScriptVehicle, connect
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.station.station import Station
from gloc3_sitl.demo.demo import free_ports

MISSION = """mission: cargo hold
frame: hold
tasks:
  depart: {actions: {climb: {take_off: {height_m: 1.5}}, down: {land: {}, after: [climb]}}}
"""


class Scene:
    """A scripted platform, and a script's station."""

    def __init__(self) -> None:
        exchange = LocalExchange()
        self.platform = ScriptedPlatform(exchange)
        self.platform.loop.call_later(0.1, self.platform.speak_every, 0.5)
        self.station = Station(exchange, self.platform.loop, "255", 11)
        self.script = ScriptStation(Desk(self.station))

    async def vehicle(self) -> ScriptVehicle:
        return await self.script.vehicle("heron", wait_s=5.0)


def test_a_mission_is_uploaded_started_followed_steered_and_ends(tmp_path: Path) -> None:
    file = tmp_path / "hold.yaml"
    file.write_text(MISSION)

    async def main() -> list[str]:
        scene = Scene()
        vehicle = await scene.vehicle()
        await vehicle.upload(file)
        await vehicle.start()
        later = scene.platform.loop.call_later
        later(5.0, lambda: scene.platform.advance("running", depart="running"))
        later(60.0, lambda: scene.platform.advance("done"))
        found = []
        async for line in vehicle.follow():
            found.append(line.text)
            if line.text == "task depart: running":
                await vehicle.pause()
                await vehicle.skip("depart.climb")
        assert (await vehicle.end()).is_done
        steered = [(body.verb, body.target) for body in scene.platform.requests if isinstance(body, Steer)]
        assert steered == [(Verb.START, ""), (Verb.PAUSE, ""), (Verb.SKIP, "depart.climb")]
        scene.station.close()
        return found

    lines = run_virtual(main())
    assert lines[0].startswith("all 13 components work; mission 'cargo hold': running")
    assert lines[-1] == "mission 'cargo hold': done"


def test_refusals_and_silence_are_exceptions() -> None:
    async def main() -> None:
        scene = Scene()
        with pytest.raises(NotHeard, match="egret did not respond within 2 s; heard: heron"):
            await scene.script.vehicle("egret", wait_s=2.0)
        vehicle = await scene.vehicle()
        with pytest.raises(Refused, match="no mission of heron was started here"):
            await vehicle.end()
        scene.platform.answer_next(Steer, refused("battery is at 12 %"))
        with pytest.raises(Refused, match="battery is at 12 %"):
            await vehicle.start(wait_s=0.0)
        await vehicle.hold()
        assert any(isinstance(body, Emergency) for body in scene.platform.requests)
        scene.platform.is_deaf = True
        with pytest.raises(NotHeard):
            await vehicle.pause()
        scene.station.close()

    run_virtual(main())


def test_control_is_taken_over_and_from_whom_is_told() -> None:
    async def main() -> None:
        scene = Scene()
        scene.platform.control = ControlState(holder="254")
        vehicle = await scene.vehicle()
        assert await vehicle.take_over() == "254"
        assert any(isinstance(body, Control) and body.verb == "take_over" for body in scene.platform.requests)
        assert await vehicle.take_over() == ""
        assert "control is taken over from station 254" in [event.text for event in scene.script.fleet.events]
        scene.station.close()

    run_virtual(main())


@pytest.mark.sockets
async def test_a_station_is_closed_at_the_end_and_its_port_is_free_again() -> None:
    (port,) = free_ports(1, socket.SOCK_DGRAM)
    for _ in range(2):
        async with connect(f"udpin://127.0.0.1:{port}") as station:
            with pytest.raises(NotHeard, match=r"a vehicle did not respond within .* s; heard: nothing"):
                await station.vehicle(wait_s=0.1)
    with pytest.raises(Refused, match="udp://"):
        async with connect("udp://1.2.3.4:5"):
            pass
