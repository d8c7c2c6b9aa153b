"""One mission with open tasks for three real flights: each does what is near, and a lost one's tasks are done by the others."""

import asyncio
from collections.abc import Coroutine
from math import dist
from pathlib import Path
from typing import Any

from tests.flight.shared_mission import SharedMission, at, block

from gloc3.clock import VirtualLoop
from gloc3.messages.command_interface import EmergencyVerb
from gloc3.messages.frames import TangentPlane
from gloc3_groundstation.cli.headless import Headless
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.flights import End
from gloc3_groundstation.missions.plans import read_plan
from gloc3_groundstation.reporting.lines import NarrationLine
from gloc3_groundstation.shared_missions.shared_flight import CrewOptions, Replacement
from gloc3_groundstation.station.station import Station
from gloc3_sitl.flight.flight import Flight

BLOCKS = {"west": (10.0, -40.0), "middle": (10.0, 0.0), "east": (10.0, 40.0), "north": (30.0, 40.0)}
TEXT = f"""\
mission: four blocks
frame: geo
on_failure: return
on_link_loss: continue
on_low_battery: land
tasks:
  up: {{platform: each, actions: {{go: {{take_off: {{height_m: 4}}}}}}}}
  west: {{platform: any, after: [up], actions: {{lines: {block(*BLOCKS["west"])}}}}}
  middle: {{platform: any, after: [up], actions: {{lines: {block(*BLOCKS["middle"])}}}}}
  east: {{platform: any, after: [up], actions: {{lines: {block(*BLOCKS["east"])}}}}}
  north: {{platform: any, after: [up], actions: {{lines: {block(*BLOCKS["north"])}}}}}
  down: {{platform: each, after: [west, middle, east, north], actions: {{home: {{return_home: {{}}}}, end: {{land: {{}}, after: [home]}}}}}}
"""
PLACES = {"pelican": (0.0, -30.0), "heron": (0.0, 6.0), "gannet": (0.0, 40.0)}


def fly(work: Coroutine[Any, Any, None]) -> None:
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        runner.run(work)


def has_flown(flight: Flight, block_name: str, since_s: float = 0.0) -> bool:
    """Whether a vehicle was really there: within 3 m of the middle of a block, by truth."""
    north_m, east_m = BLOCKS[block_name]
    home = TangentPlane(flight.plan.home)  # type: ignore[arg-type]
    middle = home.ned_from_geo(*at(north_m + 4.0, east_m + 4.0))[:2]
    return any(
        dist(sample.position_ned_m[:2], middle) < 3.0 for sample in flight.truth.samples if sample.t_s >= since_s
    )


def told(station: Station) -> list[tuple[str, str]]:
    return [(event.platform, event.text) for event in station.fleet.events]


async def task_state(flight: Flight, task: str, state: str) -> None:
    async with asyncio.timeout(120.0):
        await flight.expect("ci/mission", lambda mission: mission.tasks.get(task) == state, 120.0)


def test_a_lost_vehicle_s_tasks_are_done_by_another_in_the_same_flight(tmp_path: Path) -> None:
    async def work() -> None:
        shared, asked = SharedMission(tmp_path, TEXT, PLACES), list[Replacement]()

        async def agree(found: Replacement) -> bool:
            asked.append(found)
            return True

        async with shared.fleet() as fleet:
            station = fleet.grounds[0].station
            flight, found = await shared.begun(station)
            assert found.assigned == {"pelican": ("west",), "heron": ("middle",), "gannet": ("east", "north")}
            follow = asyncio.ensure_future(flight.follow(agree))
            await task_state(fleet.flights["gannet"], "east", "running")
            await asyncio.sleep(4.0)
            gannet = fleet.flights["gannet"]
            gannet.process.kill()
            lost_s = fleet.loop.time()
            async with asyncio.timeout(60.0):
                while not any("takes over" in event.text for event in station.fleet.events):
                    await asyncio.sleep(0.5)
            gannet.process.start()
            async with asyncio.timeout(400.0):
                end = await follow
            assert ("gannet", "it is back, and others do its tasks: its mission is aborted") in told(station)
            assert end == End(state="done", reason="gannet dropped out: no message for 10 s; others did its tasks")
            assert [one.tasks for one in asked] == [("east", "north")]
            takers = {task: name for name, tasks in asked[0].assigned.items() for task in tasks}
            for task in ("east", "north"):
                assert has_flown(fleet.flights[takers[task]], task, lost_s)
            assert has_flown(fleet.flights["pelican"], "west")
            assert has_flown(fleet.flights["heron"], "middle")

    fly(work())


SMALL = f"""\
mission: two blocks
frame: geo
on_failure: land
on_link_loss: continue
on_low_battery: land
tasks:
  up: {{platform: each, actions: {{go: {{take_off: {{height_m: 4}}}}}}}}
  west: {{platform: any, after: [up], actions: {{lines: {block(0.0, -20.0, size_m=6.0, spacing_m=3.0)}}}}}
  east: {{platform: any, after: [up], actions: {{lines: {block(0.0, 20.0, size_m=6.0, spacing_m=3.0)}}}}}
  down: {{platform: each, after: [west, east], actions: {{end: {{land: {{}}}}}}}}
"""
TWO = {"pelican": (0.0, -14.0), "heron": (0.0, 14.0)}


def test_a_script_assigns_to_all_in_contact_and_leaves_undone_what_nobody_has_agreed_to(tmp_path: Path) -> None:
    async def work() -> None:
        shared, lines = SharedMission(tmp_path, SMALL, TWO), list[NarrationLine]()
        async with shared.fleet() as fleet:
            station = fleet.grounds[0].station
            crew = CrewOptions(files=tuple(shared.files.values()))
            run = Headless(station, lines.append, crew=crew)
            flight = asyncio.ensure_future(run.fly(read_plan(str(shared.mission)), 30.0))
            await task_state(fleet.flights["heron"], "east", "running")
            await station.client.emergency("heron", EmergencyVerb.LAND)
            async with asyncio.timeout(200.0):
                end = await flight
            texts = [line.text for line in lines]
            assert any(text.startswith("assigned to heron: east (about") for text in texts)
            assert (end.state, end.exit_code) == ("failed", 1)
            assert end.reason.startswith("not done: east of heron (heron dropped out: its ")
            assert any("pelican: west, east (about" in text for _, text in told(station))
            assert any("--reassign assigns them" in text for text in texts)

    fly(work())


def test_the_desk_assigns_in_the_mission_s_text_and_asks_when_a_vehicle_drops_out(tmp_path: Path) -> None:
    async def work() -> None:
        shared = SharedMission(tmp_path, SMALL, TWO)
        async with shared.fleet() as fleet:
            ground = fleet.grounds[0]
            station, desk = ground.station, ground.desk()
            for name in TWO:
                await flights.await_platform(station, name)
                assert not await flights.await_ready(station, name)
            desk.crew.options = CrewOptions(files=tuple(shared.files.values()))
            assert await desk.missions.open(str(shared.mission), "pelican")
            assert desk.crew.has_unassigned
            assert desk.plan is None
            await desk.crew.assign("pelican")
            assert desk.missions.draft is not None
            assert desk.missions.draft.text == SMALL + "assigned: {pelican: [west], heron: [east]}\n"
            assert await desk.start("pelican")
            await task_state(fleet.flights["heron"], "east", "running")
            fleet.flights["heron"].process.kill()
            async with asyncio.timeout(30.0):
                while desk.crew.question is None:
                    await asyncio.sleep(0.5)
            assert desk.crew.question.tasks == ("east",)
            desk.crew.answer(is_agreed=True)
            await task_state(fleet.flights["pelican"], "east", "done")
            async with asyncio.timeout(60.0):
                while not any(text.startswith("the shared mission is done: heron") for _, text in told(station)):
                    await asyncio.sleep(0.5)

    fly(work())
