"""A station is wired in one place: what `gloc3 station` runs is what flights in virtual time run."""

import importlib
import pkgutil
from pathlib import Path
from random import Random

import pytest

import gloc3_groundstation
from gloc3.clock import run_virtual
from gloc3.mavlink.transport.memory import MemoryLink
from gloc3_groundstation import assembly
from gloc3_groundstation.assembly import NOT_IN_FLIGHTS, GroundStation, StationSetup
from gloc3_groundstation.links import links
from gloc3_groundstation.links.acoustic_route import AcousticRoute
from gloc3_groundstation.links.link import LinkContext, StationLinkCore
from gloc3_groundstation.links.links import Links
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.station.vehicles import Vehicles
from gloc3_groundstation.store.recording import SessionRecording

from .constructors import constructors_of

BUILDERS = {
    Station: {assembly.__name__},
    Links: {assembly.__name__},
    LinkContext: {assembly.__name__},
    Vehicles: {assembly.__name__},
    SessionRecording: {assembly.__name__},
    StationLinkCore: {links.__name__},
    AcousticRoute: {AcousticRoute.__module__},
}
"""A part of a station, and the modules that may construct it."""


@pytest.mark.parametrize("part", BUILDERS, ids=lambda part: part.__name__)
def test_nothing_but_the_assembly_constructs_the_parts_of_a_station(part: type) -> None:
    assert constructors_of(part) == BUILDERS[part]


def parts(setup: StationSetup) -> tuple[str, ...]:
    async def work() -> tuple[str, ...]:
        ground = GroundStation(setup)
        ground.attach(MemoryLink(ground.loop, Random(1)).a)
        names = ground.parts()
        await ground.close()
        return names

    return run_virtual(work())


def test_what_a_flight_s_station_lacks_is_listed_with_the_reason(tmp_path: Path) -> None:
    flown, real = parts(StationSetup(boot=1)), parts(StationSetup(boot=1, record=tmp_path))
    assert flown == ("Station", "EventsDesk", "Links", "Vehicles", "Traffic", "Corrections", "ServicesDesk")
    assert set(real) - set(flown) <= set(NOT_IN_FLIGHTS)
    modules = pkgutil.walk_packages(gloc3_groundstation.__path__, "gloc3_groundstation.")
    known = {name for module in modules for name in vars(importlib.import_module(module.name))}
    assert set(NOT_IN_FLIGHTS) <= known
