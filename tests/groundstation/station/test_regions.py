"""Vehicles that a station does not watch: known by summaries of their regions, with events when something changes."""

from msgspec.structs import replace

from gloc3.messages.envelope import Envelope, Severity, Source
from gloc3.messages.summaries import RegionSummary, VehicleLine
from gloc3.messages.wire import type_name
from gloc3_groundstation.station.regions import receive_region
from gloc3_groundstation.station.snapshots import Fleet, PlatformSnapshot
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.fleet import unwatched_lines

HERON = VehicleLine("heron", 0.2, "working", "POSCTL", False, "on_ground", 83)


def received(fleet: Fleet, *lines: VehicleLine, now_s: float = 10.0) -> Fleet:
    summary = RegionSummary(vehicles=list(lines))
    source = Source("regions", "coast", 1)
    envelope = Envelope("regions/coast/health", source, 0, 0.0, "", type_name(RegionSummary), summary)
    return receive_region(fleet, envelope, now_s)


def texts(fleet: Fleet) -> list[tuple[Severity, str, str]]:
    return [(event.severity, event.platform, event.text) for event in fleet.events]


def test_what_changes_of_a_vehicle_that_is_not_watched_is_an_event() -> None:
    pelican = PlatformSnapshot(name="pelican", boot=1, first_received_s=0.0, received_s=0.0)
    fleet = Fleet(platforms={"pelican": pelican})
    flying = replace(HERON, mode="AUTO.MISSION", is_armed=True, landed="in_air", mission="m", mission_state="running")
    faulty = replace(flying, health="faulty")
    silent = replace(faulty, age_s=6.0)
    for line in (HERON, HERON, flying, faulty, silent, silent, faulty):
        fleet = received(fleet, line, VehicleLine("shag", -1.0), replace(HERON, name="pelican"))
    assert texts(fleet) == [
        (Severity.NOTICE, "heron", "is heard by coast: working, Position, disarmed, battery 83 %"),
        (Severity.INFO, "heron", "working, Mission, armed, battery 83 %, mission m running (coast)"),
        (Severity.WARNING, "heron", "is faulty (coast)"),
        (Severity.WARNING, "heron", "is not heard by coast any more"),
        (Severity.NOTICE, "heron", "is heard by coast: faulty, Mission, armed, battery 83 %, mission m running"),
    ]
    assert [(router, line.name) for router, _, line in fleet.elsewhere()] == [("coast", "heron"), ("coast", "shag")]
    assert list(fleet.platforms) == ["pelican"]


def test_the_screen_shows_them_below_the_watched_ones() -> None:
    fleet = received(Fleet(), replace(HERON, health="faulty"), VehicleLine("shag", -1.0), now_s=10.0)
    view = StationView(fleet, None, 11.0, 0.0, "alice")
    lines = ["".join(span.text for span in line) for line in unwatched_lines(view, 120)]
    assert lines[0].split() == ["heron", "Position", "disarmed", "83", "%", "by", "coast", "faulty"]
    assert lines[1].split() == ["shag", "–", "by", "coast", "silent"]
