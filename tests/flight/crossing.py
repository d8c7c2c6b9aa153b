"""Two vehicles on crossing ways, in virtual time: how near they come, by truth."""

import asyncio
from math import dist
from pathlib import Path
from typing import NamedTuple

from tests.flight.fleet_flight import FleetFlight
from tests.flight.shared_mission import FIELD, SharedMission, at, corner

from gloc3.messages.frames import TangentPlane, Vector3
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.flights import End

SEPARATION_M = 6.0
LIMITS = f"limits: {{separation_m: {SEPARATION_M:g}}}\n"
HOMES = {"alpha": (0.0, -30.0), "beta": (-30.0, 0.0)}
FAR = {"alpha": (0.0, 30.0), "beta": (30.0, 0.0)}


def crossing_mission(speed_m_s: float = 2.0) -> str:
    """Each flies straight across the other's way, at the same height and time."""
    tasks = "".join(
        f"  {name}_up: {{platform: {name}, actions: {{go: {{take_off: {{height_m: 4}}}}}}}}\n"
        f"  {name}_across: {{platform: {name}, after: [{name}_up], actions: {{go: {{follow_waypoints: "
        f"{{waypoints: [[{corner(*FAR[name])[1:-1]}, 4]], speed_m_s: {speed_m_s:g}}}}}, "
        f"end: {{land: {{}}, after: [go]}}}}}}\n"
        for name in HOMES
    )
    return f"mission: crossing ways\nframe: geo\non_failure: land\non_link_loss: continue\ntasks:\n{tasks}"


class Crossing(NamedTuple):
    """What came of it."""

    nearest_m: float
    """Least distance between the two while both were in the air, by truth."""
    events: tuple[tuple[str, str], ...]
    end: End
    tracks: dict[str, list[tuple[float, Vector3]]]
    """Time and place in the field's NED, m."""


def tracks_of(fleet: FleetFlight) -> dict[str, list[tuple[float, Vector3]]]:
    """Where the vehicles were, by truth, in one NED."""
    plane, found = TangentPlane(FIELD), dict[str, list[tuple[float, Vector3]]]()
    for name, flight in fleet.flights.items():
        own = TangentPlane(flight.plan.home)  # type: ignore[arg-type]
        found[name] = [
            (sample.t_s, plane.ned_from_geo(*own.geo_from_ned(sample.position_ned_m)))
            for sample in flight.truth.samples
        ]
    return found


def least_m(tracks: dict[str, list[tuple[float, Vector3]]], one: str, other: str) -> float:
    """The least distance of two vehicles while both were higher than 1.5 m."""
    places = {round(t_s, 1): place for t_s, place in tracks[other] if -place[2] > 1.5}
    return min(
        dist(place, places[round(t_s, 1)]) for t_s, place in tracks[one] if -place[2] > 1.5 and round(t_s, 1) in places
    )


async def cross(folder: Path, limits: str, within_s: float = 200.0, *, speed_m_s: float = 2.0) -> Crossing:
    """Flies them."""
    shared = SharedMission(folder, crossing_mission(speed_m_s), HOMES, limits=limits)
    async with shared.fleet() as fleet:
        station = fleet.grounds[0].station
        flight = await shared.start(station)
        async with asyncio.timeout(within_s):
            end = await flights.follow_all(station, flight)
        tracks = tracks_of(fleet)
        events = tuple((event.platform, event.text) for event in station.fleet.events)
        return Crossing(least_m(tracks, "alpha", "beta"), events, end, tracks)


__all__ = ["SEPARATION_M", "Crossing", "at", "cross", "crossing_mission", "least_m", "tracks_of"]
