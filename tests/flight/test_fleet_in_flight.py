"""Several vehicles and stations fly together, each vehicle the whole stack: missions across platforms, and who commands."""

import asyncio
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import pytest
from tests.flight.fleet_flight import FleetFlight
from tests.flight.fleet_trial import run_trial

from gloc3.clock import VirtualLoop
from gloc3.errors import Gloc3Error
from gloc3.log.commands import list_commands, render_commands
from gloc3.log.reader import LogReader
from gloc3.mavlink.transport.memory import Conditions
from gloc3.messages.command_interface import CallFunction, EmergencyVerb, Verb
from gloc3.mission.model.states import ActionState
from gloc3_groundstation.desk import flights
from gloc3_groundstation.missions.plans import CheckedPlan, read_plan
from gloc3_groundstation.station.station import Station
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan

TOGETHER = """\
mission: two in the hold
frame: hold
on_failure: land
on_link_loss: continue
platform_loss_after_s: 4
tasks:
  rise: {platform: pelican, actions: {climb: {take_off: {height_m: 1.5}}}}
  follow:
    platform: heron
    after: [rise]
    actions:
      climb: {take_off: {height_m: 2}}
      out: {follow_waypoints: {waypoints_m: [[3, 0, 2]], speed_m_s: 1}, after: [climb]}
      down: {land: {}, after: [out]}
  back: {platform: pelican, after: [follow], actions: {down: {land: {}}}}
"""


def fly(work: Coroutine[Any, Any, None]) -> None:
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        runner.run(work)


@pytest.fixture
def plan(tmp_path: Path) -> CheckedPlan:
    """A mission for two, in a file."""
    return in_file(tmp_path, TOGETHER)


def in_file(folder: Path, text: str) -> CheckedPlan:
    file = folder / "together.yaml"
    file.write_text(text)
    return read_plan(str(file))


def pair(plan: CheckedPlan, stations: int = 1) -> FleetFlight:
    return FleetFlight(
        [FlightPlan(mission=plan.file, name=name, seed=number) for number, name in enumerate(("pelican", "heron"))],
        stations,
    )


async def begun(station: Station, plan: CheckedPlan) -> dict[str, flights.Follower]:
    for name in plan.platforms:
        await flights.await_platform(station, name)
        assert not await flights.await_ready(station, name)
    await flights.stream_to_all(station, plan.platforms, plan)
    return await flights.start_all(station, plan.platforms)


async def until(station: Station, name: str, task: str, state: str, within_s: float = 60.0) -> None:
    """Waits until a platform tells that of a task."""
    async with asyncio.timeout(within_s):
        while True:
            platform = station.fleet.get(name)
            if (
                platform is not None
                and platform.mission is not None
                and platform.mission.value.tasks.get(task) == state
            ):
                return
            await asyncio.sleep(0.1)


def test_one_waits_for_the_other_and_goes_on_when_it_has_landed(plan: CheckedPlan) -> None:
    async def work() -> None:
        async with pair(plan) as fleet:
            station = fleet.grounds[0].station
            followers = await begun(station, plan)
            async with asyncio.timeout(120):
                end = await flights.follow_all(station, followers)
            assert end.is_done, end
            flown = {
                name: max(-sample.position_ned_m[2] for sample in one.truth.samples)
                for name, one in fleet.flights.items()
            }
            assert flown["pelican"] == pytest.approx(1.5, abs=0.3)
            assert flown["heron"] == pytest.approx(2.0, abs=0.3)
            over = {
                name: next(s.t_s for s in reversed(one.truth.samples) if -s.position_ned_m[2] > 1.0)
                for name, one in fleet.flights.items()
            }
            assert over["pelican"] > over["heron"]

    fly(work())


def test_who_waits_for_a_lost_vehicle_follows_the_policy(plan: CheckedPlan) -> None:
    async def work() -> None:
        async with pair(plan) as fleet:
            station = fleet.grounds[0].station
            await begun(station, plan)
            await until(station, "heron", "follow.out", "running")
            fleet.flights["heron"].process.kill()
            await until(station, "pelican", "back", "waiting")
            async with asyncio.timeout(10):
                while not (pelican := station.fleet.get("pelican")) or pelican.mission.value.policy != "hold":  # type: ignore[union-attr]
                    await asyncio.sleep(0.1)
            fleet.flights["heron"].process.start()
            await until(station, "pelican", "follow", "paused")
            await station.client.steer("heron", Verb.RESUME)
            await station.client.steer("pelican", Verb.RESUME)
            await until(station, "pelican", "back", "done", 90.0)

    fly(work())


def test_another_station_takes_over_and_passes_on_in_place_of_the_first(plan: CheckedPlan) -> None:
    async def work() -> None:
        async with pair(plan, stations=2) as fleet:
            first, second = (ground.station for ground in fleet.grounds)
            await begun(first, plan)
            await until(first, "heron", "follow", "running")
            await fleet.grounds[0].close()
            for name in plan.platforms:
                await second.client.request_control(name, is_take_over=True)
            await until(second, "pelican", "back", "done", 90.0)

    fly(work())


def test_a_station_without_control_is_not_believed(plan: CheckedPlan) -> None:
    async def work() -> None:
        from gloc3.messages.command_interface import Elsewhere
        from gloc3.mission.model.model import digest_of

        async with pair(plan, stations=2) as fleet:
            first, second = (ground.station for ground in fleet.grounds)
            await begun(first, plan)
            await until(first, "pelican", "rise", "running")
            lie = Elsewhere(platform="heron", digest=digest_of(plan.text), state="done", tasks={"follow": "done"})
            for _ in range(20):
                second.client.send("pelican", lie)
                await asyncio.sleep(0.2)
            reported = [event.text for event in first.fleet.events if event.platform == "pelican"]
            assert "station 254 reports heron without control: ignored" in reported
            pelican = first.fleet.get("pelican")
            assert pelican is not None
            assert pelican.mission is not None
            assert pelican.mission.value.tasks["back"] == ActionState.WAITING
            for name in plan.platforms:
                await first.client.emergency(name, EmergencyVerb.LAND)

    fly(work())


def test_the_logs_tell_who_commanded_what(plan: CheckedPlan, tmp_path: Path) -> None:
    async def work() -> None:
        flown = FlightPlan(mission=plan.file, name="heron", out=tmp_path / "run")
        async with FleetFlight([flown], stations=2) as fleet:
            first, second = (ground.station for ground in fleet.grounds)
            await flights.await_platform(first, "heron")
            assert not await flights.await_ready(first, "heron")
            await flights.stream(first, "heron", plan)
            with pytest.raises(Gloc3Error, match="station 255 holds control"):
                await second.client.steer("heron", Verb.START)
            await second.client.emergency("heron", EmergencyVerb.HOLD)

    fly(work())
    with LogReader(tmp_path / "run" / "log.mcap") as reader:
        commands = list_commands(reader)
    assert [(one.sender, one.what.split()[0], one.outcome) for one in commands] == [
        ("255", "Control", "accepted"),
        ("255", "LoadMission", "accepted"),
        ("254", "Steer", "refused"),
        ("254", "Emergency", "accepted"),
    ]
    text = render_commands(commands)
    assert (
        "operator 254 (udpout://station-2:14550): Steer start: refused: station 255 holds control; request control first"
        in text
    )
    assert "Emergency hold station 254: accepted" in text


def test_a_second_way_takes_over_when_the_first_is_cut_and_nothing_is_done_or_told_twice(plan: CheckedPlan) -> None:
    async def work() -> None:
        async with FleetFlight([FlightPlan(mission=plan.file, name="heron")]) as fleet:
            heron, ground = fleet.flights["heron"], fleet.grounds[0]
            station, wifi, radio = ground.station, ground.radios["heron"], heron.process.add_radio()
            ground.join("heron", radio)
            requested = received(heron)
            await flights.await_platform(station, "heron")
            assert not await flights.await_ready(station, "heron")
            await flights.request_control(station, "heron")
            for number in range(40):
                if number == 20:
                    wifi.set_conditions(Conditions(loss=1.0))
                body = CallFunction(component="hold", function="set_rate", arguments={"rate_hz": 20.0 + 0.1 * number})
                await station.client.carry_out("heron", body)
            assert requested == [20.0 + 0.1 * number for number in range(40)]
            texts = [event.text for event in station.fleet.events if event.source == "command_server"]
            assert len(texts) == len(set(texts)), "nothing is told twice"

    fly(work())


def received(flight: Flight) -> list[float]:
    """The rates that reach the hold controller, from now on."""
    rates: list[float] = []
    topic = f"{flight.name}/components/hold/function"
    flight.exchange.subscribe(topic, lambda envelope: rates.append(envelope.payload.arguments["rate_hz"]))
    return rates


def test_none_starts_where_one_may_not(plan: CheckedPlan, tmp_path: Path) -> None:
    async def work() -> None:
        async with pair(plan, stations=2) as fleet:
            first, second = (ground.station for ground in fleet.grounds)
            for name in plan.platforms:
                await flights.await_platform(first, name)
                assert not await flights.await_ready(first, name)
            await flights.stream_to_all(first, plan.platforms, plan)
            await second.client.request_control("heron", is_take_over=True)
            with pytest.raises(Gloc3Error, match="station 254 holds control"):
                await flights.start_all(first, plan.platforms)
            await until(first, "pelican", "rise", "aborted")

    del tmp_path
    fly(work())


def test_no_command_is_executed_twice_or_by_another_vehicle_whoever_takes_control() -> None:
    found = run_trial(seed=1, platforms=2, stations=3, span_s=40.0)
    assert found.wrong == []
    assert found.accepted >= 10
    assert found.refused >= 10
    assert sum(found.hand_overs.values()) >= 5
    assert found.crashed_holding >= 1
    assert 0.0 < found.late_full_s < 5.0, "who comes late knows everything soon"
