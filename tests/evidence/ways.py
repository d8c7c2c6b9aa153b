"""Missions of whole stacks in virtual time, judged by where the vehicle truly was, and by where it took itself to be."""

import math
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import fmean
from typing import NamedTuple

from gloc3.clock import run_virtual
from gloc3.evaluation.requested_path import RequestedPath
from gloc3.log.report.plot import plot_path
from gloc3.messages.envelope import Envelope
from gloc3.messages.frames import Vector3
from gloc3.messages.vehicle import Pose
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan
from gloc3_sitl.physics.wind import CALM, gusty

WITHIN_S = 1500.0
PERIOD_S = 0.1
DRAWN = 600
"""So many places of a way are drawn."""


class Around(NamedTuple):
    """In what a vehicle moves."""

    wind_m_s: float = 0.0
    waves_m: float = 0.0
    current_m_s: float = 0.0
    has_plain_gps: bool = False

    def reported(self) -> str:
        """In words."""
        parts = [f"wind {self.wind_m_s:g} m/s"] if self.wind_m_s else []
        parts += [f"waves {self.waves_m:g} m"] if self.waves_m else []
        parts += [f"current {self.current_m_s:g} m/s"] if self.current_m_s else []
        parts += ["metre-level fixes"] if self.has_plain_gps else []
        return ", ".join(parts) or "calm"


class Way(NamedTuple):
    """What was asked for and what was done; NED in metres, down by the true depth or height from home."""

    state: str
    true: list[Vector3]
    believed: list[Vector3]
    """By its own pose, at the same times."""
    requested: list[Vector3]


def lost(mission: str, platform: str, around: Around, seed: int, out: Path | None = None) -> Way:
    """Carries a mission out, and gives its first way along waypoints."""
    wind = gusty(around.wind_m_s, from_deg=270.0) if around.wind_m_s else CALM
    plan = FlightPlan(
        mission=mission,
        platform=platform,
        seed=seed,
        wind=wind,
        waves_m=around.waves_m,
        current_m_s=around.current_m_s,
        is_plain_gps=around.has_plain_gps,
        out=out,
    )
    return run_virtual(_go(plan))


async def _go(plan: FlightPlan) -> Way:
    seen: list[tuple[float, Vector3, Vector3]] = []

    def see(envelope: Envelope[Pose]) -> None:
        if flight.truth.samples and (not seen or envelope.t_s - seen[-1][0] >= PERIOD_S - 1e-3):
            (north, east, _), down = flight.truth.samples[-1].position_ned_m, flight.simulator.truth().position_ned_m[2]
            seen.append((envelope.t_s, (north, east, down), envelope.payload.position_ned_m))

    async with Flight(plan) as flight:
        path = RequestedPath(flight.exchange, flight.name)
        flight.exchange.subscribe(f"{flight.name}/pose", see)
        end = await flight.await_end(await flight.upload_and_start(), WITHIN_S)
    requested = max(path.flights, key=lambda one: len(one.polyline_ned_m))
    end_s = math.inf if requested.end_s is None else requested.end_s
    running = [(true, believed) for t_s, true, believed in seen if requested.start_s <= t_s <= end_s]
    return Way(end.state, [true for true, _ in running], [own for _, own in running], requested.polyline_ned_m)


def beside_m(places: Sequence[Vector3], requested: Sequence[Vector3], corner_m: float) -> float:
    """RMS of the distance beside the nearest leg, of places farther than `corner_m` from both its ends, on the map."""
    flat = [(north, east, 0.0) for north, east, _ in requested]
    legs = [leg for leg in pairwise(flat) if math.dist(*leg) > 0.0]
    found = [_beside((at[0], at[1], 0.0), *min(legs, key=partial(_off_m, (at[0], at[1], 0.0)))) for at in places]
    return math.sqrt(fmean(off_m**2 for off_m, on_m, length_m in found if corner_m < on_m < length_m - corner_m))


def missed_m(places: Sequence[Vector3], requested: Sequence[Vector3]) -> float:
    """The farthest miss of a waypoint: how near the nearest place was, on the map."""
    return max(min(math.dist(at[:2], corner[:2]) for at in places) for corner in requested[1:])


def _beside(at: Vector3, begin: Vector3, end: Vector3) -> tuple[float, float, float]:
    """How far beside a leg a place is, how far along it, and how long the leg is."""
    north, east = end[0] - begin[0], end[1] - begin[1]
    length_m = math.hypot(north, east)
    n, e = at[0] - begin[0], at[1] - begin[1]
    return (e * north - n * east) / length_m, (n * north + e * east) / length_m, length_m


def draw(way: Way, file: Path, title: str) -> None:
    """Draws the path flown against the path requested, with no more points than are seen."""
    plot_path(_thinned(way.true), way.requested, file, home=way.true[0], waypoints=way.requested[1:], title=title)


def _thinned(places: Sequence[Vector3]) -> list[Vector3]:
    """Places so near to each other that the line looks the same, and that a height is found its place along the way."""
    apart_m = min(1.5, sum(math.dist(a, b) for a, b in pairwise(places)) / DRAWN)
    kept = [places[0]]
    for place in places[1:-1]:
        if math.dist(place, kept[-1]) >= apart_m:
            kept.append(place)
    return [*kept, places[-1]]


def _off_m(at: Vector3, leg: tuple[Vector3, Vector3]) -> float:
    """Distance from a straight piece."""
    begin, end = leg
    length_m = math.dist(begin, end)
    if length_m == 0.0:
        return math.dist(at, begin)
    on = sum((p - b) * (e - b) for p, b, e in zip(at, begin, end, strict=True)) / length_m
    on = min(max(on, 0.0), length_m) / length_m
    return math.dist(at, tuple(b + on * (e - b) for b, e in zip(begin, end, strict=True)))
