"""Vehicles that a station does not watch in detail: their health by the summaries of their regions."""

from collections.abc import Iterator
from typing import Any, Final

from msgspec.structs import replace

from gloc3.mavlink.flight_modes import mode_words
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.summaries import WELL, RegionSummary, VehicleLine
from gloc3_groundstation.station.fleet import note
from gloc3_groundstation.station.snapshots import Fleet, Timed

SILENT_S: Final = 5.0
"""A vehicle that its router has not heard for so long is silent, s."""


def receive_region(fleet: Fleet, envelope: Envelope[Any], now_s: float) -> Fleet:
    """The fleet after the summary of a region; changes of vehicles that are not watched become events."""
    summary = envelope.payload
    if not isinstance(summary, RegionSummary):
        return fleet
    router = envelope.topic.split("/")[1]
    before = fleet.regions.get(router)
    known = {} if before is None else {line.name: line for line in before.value.vehicles}
    fleet = replace(fleet, regions={**fleet.regions, router: Timed(summary, now_s)})
    for line in summary.vehicles:
        if fleet.get(line.name) is None:
            for severity, text in _changes(known.get(line.name), line, router):
                fleet = note(fleet, line.name, severity, text, now_s)
    return fleet


def is_silent(line: VehicleLine) -> bool:
    """Whether its router has not heard it of late."""
    return not 0.0 <= line.age_s < SILENT_S


def _changes(before: VehicleLine | None, now: VehicleLine, router: str) -> Iterator[tuple[Severity, str]]:
    if before is None or is_silent(before) != is_silent(now):
        if not is_silent(now):
            yield Severity.NOTICE, f"is heard by {router}: {_words(now)}"
        elif before is not None:
            yield Severity.WARNING, f"is not heard by {router} any more"
        return
    if is_silent(now):
        return
    if before.health != now.health and now.health:
        severity = Severity.NOTICE if now.health in WELL else Severity.WARNING
        yield severity, f"is {now.health} ({router})"
    if (before.is_armed, before.mode) != (now.is_armed, now.mode) and before.mode:
        yield Severity.INFO, f"{_words(now)} ({router})"


def _words(line: VehicleLine) -> str:
    battery = f", battery {line.battery_percent} %" if line.battery_percent >= 0 else ""
    mission = f", mission {line.mission} {line.mission_state}" if line.mission_state else ""
    mode, arming = mode_words(line.mode) or "mode unknown", "armed" if line.is_armed else "disarmed"
    return f"{line.health or 'health unknown'}, {mode}, {arming}{battery}{mission}"
