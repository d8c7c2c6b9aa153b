"""A vehicle's onboard side is wired in one place: what `gloc3 onboard` runs is what flights in virtual time run."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import pytest

from gloc3.clock import run_virtual
from gloc3.mavlink.router import Router
from gloc3.network.stations import StationBridge
from gloc3.platform.reader import load_platform
from gloc3_onboard import assembly
from gloc3_onboard.autopilot.arm_authority import ArmAuthority
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.cli import doctor_run, platform_new
from gloc3_onboard.command_server.site import Site
from gloc3_onboard.companion.acoustic_link import AcousticLink
from gloc3_onboard.companion.autopilot_reporter import AutopilotReporter
from gloc3_onboard.companion.companion import Companion
from gloc3_onboard.companion.link_watch import LinkWatch, RateWatch
from gloc3_onboard.companion.routing import RoutedLink
from gloc3_onboard.companion.station_link import HeartbeatSource, StationLink
from gloc3_onboard.hosts import other_processes
from gloc3_onboard.parts import NOT_IN_FLIGHTS
from gloc3_onboard.process.options import ProcessOptions
from gloc3_onboard.process.process import DEVICES, OnboardProcess
from gloc3_onboard.process.runner import Onboard
from gloc3_onboard.process.taps import ExchangeTaps
from gloc3_onboard.sensors.sensor_watch import SensorWatch
from gloc3_onboard.viewer.catalogue import Catalogue
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan

from .constructors import constructors_of

BUILDERS: Mapping[type, set[ModuleType]] = {
    **{each: {assembly} for each in (AcousticLink, ArmAuthority, Catalogue, Companion, ExchangeTaps, HeartbeatSource)},
    **{each: {assembly} for each in (AutopilotReporter, LinkWatch, Onboard, RateWatch, SensorWatch, Site, StationLink)},
    Router: {assembly},
    RoutedLink: {assembly},
    AutopilotLink: {assembly, doctor_run, platform_new},
    StationBridge: {other_processes},
}
"""A part of a vehicle's side, and the modules that may construct it: commands that only query an autopilot have none."""
ON_A_NETWORK = {"network events", "station bridge"}
"""Parts of an onboard process that has a network file."""
ANY_PORT = "udpin://127.0.0.1:0"


@pytest.mark.parametrize("part", BUILDERS, ids=lambda part: part.__name__)
def test_nothing_but_the_assembly_constructs_the_parts_of_a_vehicle_s_side(part: type) -> None:
    assert constructors_of(part) == {module.__name__ for module in BUILDERS[part]}


async def parts_of_a_process(folder: Path) -> dict[str, str]:
    platform = load_platform("pelican_rtk", is_loading_classes=True, devices=DEVICES)
    options = ProcessOptions(
        platform="pelican_rtk", autopilot=ANY_PORT, stations=(ANY_PORT,), acoustic=ANY_PORT, out=folder, is_quiet=True
    )
    process = OnboardProcess(options, platform, asyncio.get_running_loop())
    try:
        await process.open()
        return process.vehicle.parts.listed()
    finally:
        await process.close()


async def parts_of_a_flight() -> dict[str, str]:
    async with Flight(FlightPlan(mission="hop", modem_period_s=60.0)) as flight:
        return flight.process.vehicle.parts.listed()


@pytest.mark.sockets
def test_a_flight_has_the_parts_of_the_onboard_process_but_for_those_on_the_list(tmp_path: Path) -> None:
    real, flown = asyncio.run(parts_of_a_process(tmp_path)), run_virtual(parts_of_a_flight())
    for name, kind in real.items():
        print(f"{name:32} {kind:20} {NOT_IN_FLIGHTS.get(name, '')}")
    assert {name: kind for name, kind in real.items() if name not in NOT_IN_FLIGHTS} == flown
    assert set(real) & set(NOT_IN_FLIGHTS) == set(NOT_IN_FLIGHTS) - ON_A_NETWORK


def test_a_flight_s_process_routes_watches_and_speaks_to_other_people_s_stations() -> None:
    flown = run_virtual(parts_of_a_flight())
    for part in (Router, RoutedLink, LinkWatch, RateWatch, AutopilotReporter):
        assert part.__name__ in flown.values()
