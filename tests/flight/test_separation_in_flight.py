"""Vehicles keep their distance from each other and from traffic in flight, by truth; without the limiter they do not."""

import asyncio
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

from msgspec.structs import replace
from tests.flight.crossing import LIMITS, SEPARATION_M, cross, crossing_mission, least_m, tracks_of
from tests.flight.shared_mission import SharedMission, at

from gloc3.clock import VirtualLoop
from gloc3.messages.command_interface import Elsewhere, NearbyVehicle
from gloc3_groundstation.desk import flights
from gloc3_groundstation.station.snapshots import TrafficContact
from gloc3_groundstation.station.station import Station


def fly(work: Coroutine[Any, Any, None]) -> None:
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        runner.run(work)


def test_on_crossing_ways_one_gives_way_and_without_a_separation_they_nearly_meet(tmp_path: Path) -> None:
    async def work() -> None:
        apart = await cross(tmp_path, LIMITS)
        assert apart.end.is_done
        assert apart.nearest_m >= SEPARATION_M
        texts = [(name, text) for name, text in apart.events if "gives way" in text or "brakes for" in text]
        assert [(name, text.partition(",")[0]) for name, text in texts] == [("beta", "gives way to alpha")]
        assert ("beta", "alpha is out of the way") in apart.events
        near = await cross(tmp_path, "")
        assert near.end.is_done
        assert near.nearest_m < 0.5 * SEPARATION_M, "else this proves nothing"

    fly(work())


def test_traffic_has_the_way_and_a_station_without_control_cannot_invent_any(tmp_path: Path) -> None:
    place = at(0.0, 0.0)
    altitude_m = place.altitude_m + 4.0

    def note_traffic(station: Station) -> None:
        contact = TrafficContact(
            key="adsb 4B1234", name="HB-ZRX", place=place[:2], altitude_m=altitude_m, received_s=station.now_s()
        )
        station.change(lambda fleet, _: replace(fleet, traffic=(contact,)))

    async def work() -> None:
        shared = SharedMission(
            tmp_path, crossing_mission(), {"alpha": (0.0, -30.0), "beta": (-200.0, 0.0)}, limits=LIMITS
        )
        async with shared.fleet(stations=2) as fleet:
            station, stranger = (ground.station for ground in fleet.grounds)
            followers = await shared.start(station)
            lie = NearbyVehicle(name="lie", geo=(*place[:2], altitude_m), is_traffic=True)
            note_traffic(station)
            async with asyncio.timeout(60.0):
                while not any("gives way to HB-ZRX" in event.text for event in station.fleet.events):
                    stranger.client.send("alpha", Elsewhere(platform="", digest="", state="", vehicles=[lie]))
                    note_traffic(station)
                    await asyncio.sleep(0.5)
            for _ in range(40):
                note_traffic(station)
                await asyncio.sleep(0.5)
            _, (_, east_m, _) = tracks_of(fleet)["alpha"][-1]
            assert -20.0 < east_m < -SEPARATION_M, "it waits on this side of it"
            station.change(lambda fleet, _: replace(fleet, traffic=()))
            async with asyncio.timeout(100.0):
                assert (await flights.follow(station, "alpha", followers["alpha"])).is_done
            assert not any("lie" in event.text for event in station.fleet.events)
            assert least_m(tracks_of(fleet), "alpha", "beta") > 20.0

    fly(work())
