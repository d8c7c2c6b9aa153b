"""Orders for several vehicles, control between two stations, and links that come and go."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import msgspec
import pytest
from tests.groundstation.scripted_platform import ScriptedPlatform, refused, reply_to

from gloc3.clock import run_virtual
from gloc3.errors import Refused
from gloc3.exchange import LocalExchange
from gloc3.messages.command_interface import (
    CiReply,
    CiRequest,
    Control,
    ControlVerb,
    Emergency,
    LoadMission,
    Outcome,
    Steer,
    Verb,
)
from gloc3.messages.summaries import ControlState
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_groundstation.desk.desk import Desk, Order
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station.station import Station
from gloc3_onboard.command_server.authority import ControlAuthority

T = TypeVar("T")
PLAN = CheckedPlan(name="hold.yaml", title="cargo hold", text="mission: cargo hold\n")


class SharedPlatform(ScriptedPlatform):
    """Control of it changes hands as the real one's does."""

    def __init__(self, exchange: LocalExchange, name: str, boot: int = 7) -> None:
        super().__init__(exchange, name, boot)
        self.authority = ControlAuthority()

    def _carry_out(self, request: CiRequest) -> CiReply:
        if not isinstance(request.body, Control):
            return super()._carry_out(request)
        try:
            reported = self.authority.handle(request.sender, request.body, 5.0, self.loop.time())
        except Refused as reason:
            return reply_to(request, Outcome.REFUSED, str(reason))
        self.tell_control()
        return reply_to(request, reason=reported)

    def tell_control(self) -> None:
        self.control = self.authority.state()
        self.report("control", self.control)


def play(steps: Callable[["Stage"], Awaitable[T]]) -> T:
    async def main() -> T:
        stage = Stage()
        try:
            return await steps(stage)
        finally:
            stage.close()

    return run_virtual(main())


class Stage:
    """Two vehicles and two stations."""

    def __init__(self) -> None:
        exchange, loop = LocalExchange(), asyncio.get_running_loop()
        self.vehicles = {name: SharedPlatform(exchange, name, n) for n, name in enumerate(("heron", "egret"))}
        self.stations = [Station(exchange, loop, name, int(name)) for name in ("255", "254")]
        self.own, self.other = (Desk(station, PLAN) for station in self.stations)
        for vehicle in self.vehicles.values():
            vehicle.speak()

    def reported(self, desk: Desk) -> list[str]:
        return [f"{event.platform}: {event.text}" for event in desk.station.fleet.events]

    def requested(self, name: str, kind: type) -> list[Any]:
        return [body for body in self.vehicles[name].requests if isinstance(body, kind)]

    def close(self) -> None:
        for station in self.stations:
            station.close()


def test_an_order_goes_to_each_vehicle_of_a_selection_at_once_and_who_refused_is_told() -> None:
    async def steps(stage: Stage) -> None:
        stage.vehicles["egret"].answer_next(Steer, refused("no mission is loaded"))
        fleet = stage.own.fleet
        assert fleet.named(["egret", "stork", "heron"]) == ["heron", "egret"]
        assert await stage.own.order(["heron", "egret"], Order.PAUSE) == ["heron"]
        reported = stage.reported(stage.own)
        assert "egret: pause: no mission is loaded" in reported
        assert reported[-1] == ": pause: accepted by 1 of 2, not egret"
        assert await stage.own.order(["heron", "egret"], Order.LAND) == ["heron", "egret"]
        assert [stage.requested(name, Emergency)[0].verb for name in stage.vehicles] == ["land", "land"]
        assert stage.own.last_emergency("heron") is None, "the emergency key holds, and does not ask"
        assert await stage.own.order(["heron", "egret"], Order.START) == ["heron", "egret"]
        for name in stage.vehicles:
            assert [body.text for body in stage.requested(name, LoadMission)] == [PLAN.text]
            assert stage.requested(name, Steer)[-1] == Steer(verb=Verb.START)

    play(steps)


def test_a_mission_that_names_its_vehicles_starts_on_these_and_once_whichever_are_selected() -> None:
    async def steps(stage: Stage) -> None:
        stage.own.missions._plan = msgspec.structs.replace(PLAN, platforms=("heron", "egret"))
        assert stage.own.crew_of("stork") == ("heron", "egret")
        assert await stage.own.order(["stork", "egret", "heron"], Order.START) == ["heron", "egret"]
        for name in stage.vehicles:
            assert len(stage.requested(name, LoadMission)) == 1
            assert stage.requested(name, Steer) == [Steer(verb=Verb.START)]
        assert stage.reported(stage.own)[-1] == ": start: accepted by 2 of 2"
        stage.vehicles["egret"].answer_next(Steer, refused("pose is faulty"))
        assert await stage.own.order(["heron"], Order.START) == []
        assert stage.reported(stage.own)[-1] == ": start: accepted by 0 of 2, not heron, egret"

    play(steps)


def test_control_of_a_second_vehicle_is_asked_for_and_granted() -> None:
    async def steps(stage: Stage) -> None:
        assert await stage.other.fleet.control("egret", ControlVerb.REQUEST)
        requesting = asyncio.ensure_future(stage.own.fleet.control("egret", ControlVerb.REQUEST))
        await asyncio.sleep(1.0)
        assert "egret: station 255 requests control; grant or refuse it on the screen Fleet" in stage.reported(
            stage.other
        )
        egret = stage.stations[1].fleet.platforms["egret"]
        assert stage.other.fleet.control_verbs(egret) == {ControlVerb.GRANT, ControlVerb.REFUSE, ControlVerb.RELEASE}
        assert await stage.other.fleet.control("egret", ControlVerb.GRANT)
        assert await requesting
        assert stage.vehicles["egret"].control == ControlState(holder="255")
        assert "egret: station 255 has control now" in stage.reported(stage.other)
        assert "egret: this station has control" in stage.reported(stage.own)

    play(steps)


def test_a_refused_request_leaves_control_where_it_is_and_a_take_over_does_not_ask() -> None:
    async def steps(stage: Stage) -> None:
        await stage.other.fleet.control("heron", ControlVerb.REQUEST)
        requesting = asyncio.ensure_future(stage.own.fleet.control("heron", ControlVerb.REQUEST))
        await asyncio.sleep(1.0)
        assert await stage.other.fleet.control("heron", ControlVerb.REFUSE)
        assert not await requesting
        assert any("station 254 keeps it" in text for text in stage.reported(stage.own))
        heron = stage.stations[0].fleet.platforms["heron"]
        assert stage.own.fleet.control_verbs(heron) == {ControlVerb.REQUEST, ControlVerb.TAKE_OVER}
        assert not await stage.own.fleet.control("heron", ControlVerb.RELEASE), "it is not ours to give back"
        assert await stage.own.fleet.control("heron", ControlVerb.TAKE_OVER)
        assert stage.vehicles["heron"].control.holder == "255"
        assert await stage.own.fleet.control("heron", ControlVerb.RELEASE)
        assert stage.vehicles["heron"].control.holder == ""

    play(steps)


@pytest.mark.sockets
async def test_links_are_opened_and_closed_while_the_station_runs() -> None:
    reported = list[str]()
    ground = GroundStation(StationSetup(boot=1), report=reported.append)
    station, links = ground.station, ground.links
    desk = Desk(station, links=links)
    try:
        assert await desk.fleet.add_link("udpin://127.0.0.1:0")
        port = links._open[0].endpoint.local_port
        assert await desk.fleet.add_link(f"udpout://127.0.0.1:{port}")
        async with asyncio.timeout(20.0):
            while not (links._open[0].rates[0] and links._open[1].rates[1]):
                await asyncio.sleep(0.05)
        listening, sending = desk.fleet.links()
        assert listening.bytes_in_s >= 21.0
        assert sending.frames_out >= 1
        assert listening.frames_in >= 1
        assert not await desk.fleet.add_link("udpin://127.0.0.1:0")
        assert not await desk.fleet.add_link("smoke://signals")
        assert await desk.fleet.remove_link(f"udpout://127.0.0.1:{port}")
        assert not await desk.fleet.remove_link(f"udpout://127.0.0.1:{port}")
        assert [link.url for link in desk.fleet.links()] == ["udpin://127.0.0.1:0"]
        texts = [event.text for event in station.fleet.events if "link" in event.text]
        assert f"link udpout://127.0.0.1:{port} is open" in texts
        assert any("no scheme 'smoke'" in text for text in texts)
        assert any("is open already" in text for text in texts)
    finally:
        station.close()
        await links.close()
