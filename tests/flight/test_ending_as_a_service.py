"""The service is told to end, or to read its file again, while the vehicle flies."""

import asyncio

import msgspec
import pytest
from tests.flight.card import ONE_STYLE, Card
from tests.flight.missions import mission

from gloc3.messages.envelope import Severity
from gloc3.messages.vehicle import FlightMode
from gloc3.platform.platform import Platform
from gloc3_onboard.service.departure import Departure
from gloc3_onboard.service.reload import PlatformReload


class Ending:
    """What a service does at its end, and what it asks and says meanwhile."""

    def __init__(self, flight: Card, on_stop: str) -> None:
        self.extended: list[float] = []
        self.reported: list[str] = []
        self.hurried = asyncio.Event()
        platform = msgspec.structs.replace(flight.flight.platform, on_stop=on_stop)
        self.departure = Departure(
            flight.flight.exchange, platform, flight.flight.loop, 7, self.extended.append, self._report
        )
        flight.wait(1.0)

    def _report(self, _: Severity, text: str) -> None:
        self.reported.append(text)


@ONE_STYLE
def test_a_vehicle_whose_file_says_so_lands_before_the_service_ends(flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep", "running")
    ending = Ending(flight, "land")
    begin_s = flight.now_s
    flight.run(ending.departure.land(ending.hurried))
    assert flight.height_m < 0.2
    assert not flight.autopilot.is_armed
    assert flight.now_s - begin_s < 15.0
    assert len(ending.extended) > 20, "all the while the manager is asked for time"
    assert ending.reported == ["the vehicle lands first; a second stop signal leaves it to its autopilot"]
    onboard = flight.flight.process.onboard
    assert onboard is not None
    flight.run(onboard.stop())
    assert all(state is None for state in (onboard.state(name) for name in onboard.hosts))


UNDER_WAY = {
    "boat": """\
mission: out
frame: site
on_failure: land
tasks:
  away: {actions: {off: {drive_off: {}}}}
  out: {after: [away], actions: {line: {go_to: {position_m: [60, 0, 0], speed_m_s: 1.5}}}}
""",
    "auv": """\
mission: out
frame: bay
on_failure: land
on_pose_lost: land
tasks:
  away: {actions: {off: {dive: {depth_m: 2}}}}
  out: {after: [away], actions: {line: {go_to: {position_m: [30, 0, -2], speed_m_s: 0.5}}}}
""",
}


@pytest.mark.parametrize("style", ["ardupilot"], indirect=True)
@pytest.mark.parametrize("vehicle", UNDER_WAY)
def test_a_boat_stops_and_a_submarine_surfaces_before_the_service_ends(flight: Card, vehicle: str) -> None:
    flight.begin(UNDER_WAY[vehicle], platform=vehicle)
    flight.await_state("out", "running", within_s=120.0)
    flight.wait(4.0)
    ending = Ending(flight, "land")
    flight.run(ending.departure.land(ending.hurried))
    assert not flight.autopilot.is_armed
    assert len(ending.reported) == 1, ending.reported
    assert flight.position_m[2] > -0.5


@ONE_STYLE
def test_who_is_told_twice_leaves_the_landing_to_the_autopilot(flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep", "running")
    ending = Ending(flight, "land")

    async def twice() -> None:
        flight.flight.loop.call_later(1.0, ending.hurried.set)
        await ending.departure.land(ending.hurried)
        onboard = flight.flight.process.onboard
        assert onboard is not None
        await onboard.stop()

    flight.run(twice())
    assert ending.reported[-1] == "leaves the vehicle in the air: a second stop signal"
    assert flight.autopilot.is_armed
    assert flight.received["autopilot"][-1].payload.mode is FlightMode.LAND
    assert flight.height_m > 0.5


@ONE_STYLE
def test_a_component_that_works_in_flight_gets_its_settings_on_the_ground(flight: Card) -> None:
    flight.begin(mission())
    flight.await_state("sweep", "running")
    ending = Ending(flight, "hold")
    begun, onboard = flight.flight.platform, flight.flight.process.onboard
    assert onboard is not None
    rows = [
        msgspec.structs.replace(row, settings={**row.settings, "acceleration_m_s2": 0.9})
        if row.name == "waypoints"
        else row
        for row in begun.components
    ]
    changed: Platform = msgspec.structs.replace(begun, components=tuple(rows))
    reload = PlatformReload(
        begun,
        lambda: changed,
        onboard.hosts,
        flight.flight.exchange,
        flight.flight.loop,
        8,
        lambda: ending.departure.is_at_rest,
        lambda _, text: ending.reported.append(text),
    )
    begin_s = flight.now_s
    flight.run(ending.departure.land(ending.hurried))
    assert (flight.now_s, ending.reported, ending.extended) == (begin_s, [], []), "by default nothing is landed"
    flight.wait(2.0)
    flight.run(reload.read_again())
    flight.await_landed()
    flight.await_state("mission", "done", 60.0)
    flight.wait(2.0)
    flight.run(reload.read_again())
    flight.run(reload.read_again())
    assert ending.reported == [
        "reloaded: waypoints: settings: it is working, and the vehicle is armed or on a mission: reload again on the ground",
        "reloaded: waypoints: settings: adopted",
        "reloaded: nothing has changed",
    ]
    assert onboard.hosts["waypoints"].settings["acceleration_m_s2"] == 0.9
