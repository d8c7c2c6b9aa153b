"""Alerts of an operator: one for each cause, with its consequences in it, and none while nothing is wrong."""

import asyncio
import os
import signal
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.commands.programs import program
from tests.flight.card import ONE_STYLE, Card
from tests.flight.test_single_go_to import FENCED, go_to

from gloc3.messages.envelope import Severity
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.station.alerts import Alerts, acknowledge, update
from gloc3_sitl.demo.demo import free_ports

UNPLANNED = "mission.yaml:4:1: the mission ends in the air"
"""A finding of the mission that these flights use."""


def alerts_of(flight: Card) -> list[str]:
    """The texts of all alerts of the flight so far."""
    found = update(Alerts(), flight.flight.station.fleet, flight.now_s).listed
    return [alert.story for alert in found if not alert.text.startswith(UNPLANNED)]


def in_flight(flight: Card) -> None:
    flight.begin(FENCED, platform="pelican_rtk")
    flight.await_state("mission", "done", 60.0)
    assert alerts_of(flight) == []
    assert go_to(flight, 6.0, 1.0, 2.0) == ""
    flight.wait(1.0)


@ONE_STYLE
def test_a_go_to_that_is_taken_away_is_one_alert(flight: Card) -> None:
    in_flight(flight)
    assert flight.component("waypoints", "stop", is_forced=True).reason == ""
    flight.wait(3.0)
    (alert,) = alerts_of(flight)
    assert alert == "mission: command-2.go_to failed: waypoints: ended by a forced stop; command-2 failed; policy hold"


@ONE_STYLE
def test_a_component_that_fails_in_a_go_to_is_one_alert(flight: Card) -> None:
    in_flight(flight)
    alerts = Alerts()
    flight.fault("crash:waypoints")
    for _ in range(30):
        flight.wait(0.1)
        alerts = update(alerts, flight.flight.station.fleet, flight.now_s)
    (alert,) = [one for one in alerts.listed if not one.text.startswith(UNPLANNED)]
    assert alert.severity is Severity.ERROR
    assert "injected crash of waypoints; " in alert.story
    for consequence in ("command-2.go_to failed", "command-2 failed", "policy hold", "initialize, start waypoints"):
        assert alert.story.count(f"; {consequence}") == 1, alert.story
    assert acknowledge(alerts).pending == []


@ONE_STYLE
def test_a_lost_pose_in_a_go_to_is_one_alert(flight: Card) -> None:
    in_flight(flight)
    flight.fault("topic:autopilot_pose=lost")
    flight.wait(6.0)
    (alert,) = alerts_of(flight)
    assert alert.endswith("; pose lost; policy land")


@pytest.mark.sockets
async def test_a_first_session_has_no_alert_and_a_process_that_stalls_one(tmp_path: Path) -> None:
    companion, ground = free_ports(2, socket.SOCK_DGRAM)
    station = f"udpout://127.0.0.1:{ground}"
    both = ("--link", f"companion=udpout://127.0.0.1:{companion}", "--link", f"station={station}")
    links = ("--autopilot", f"udpin://127.0.0.1:{companion}", "--station", station)
    here = GroundStation(StationSetup(boot=11, downloads=tmp_path))
    desk = Desk(here.station, services=here.services)

    async def until(is_it: Callable[[], bool], within_s: float = 60.0) -> None:
        async with asyncio.timeout(within_s):
            while not is_it():
                desk.alerts()
                await asyncio.sleep(0.1)

    def is_all_well() -> bool:
        platform = here.station.fleet.get("pelican")
        return platform is not None and platform.is_all_well(here.station.now_s())

    def passed(seconds: float) -> Callable[[], bool]:
        end_s = here.station.now_s() + seconds
        return lambda: here.station.now_s() >= end_s

    try:
        await here.open([f"udpin://127.0.0.1:{ground}"])
        with (
            program("sitl", *both, folder=tmp_path),
            program("onboard", "pelican_rtk", *links, "--out", "onboard", folder=tmp_path) as onboard,
        ):
            await until(is_all_well)
            await until(passed(6.0))
            assert desk.alerts().listed == []
            assert [event.text for event in here.station.fleet.events if event.severity <= Severity.WARNING] == []
            os.kill(onboard.process.pid, signal.SIGSTOP)
            await until(passed(5.0))
            os.kill(onboard.process.pid, signal.SIGCONT)
            await until(passed(1.0))
            await until(is_all_well)
            await until(passed(6.0))
            (alert,) = desk.alerts().listed
            assert alert.text.startswith("no messages from it any more")
            assert alert.consequences[0].startswith("this process stalled for ")
            assert alert.is_cleared
    finally:
        await here.close()
