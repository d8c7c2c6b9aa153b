"""How well each vehicle keeps a way: one mission file, calm and rough, over seeds; a vehicle is a row."""

import math
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from tests.evidence.page import PAGES, Bar, Figure, Progress

from gloc3.clock import run_virtual
from gloc3.frames import Vector3
from gloc3.log.plot import plot_path
from gloc3.requested_path import RequestedPath
from gloc3_sitl.flight import Flight, FlightPlan
from gloc3_sitl.wind import CALM, gusty

SEEDS = range(1, 11)
CORNER_M = 8.0
"""Farther than this along a leg from both its ends it is straight: what turns wide has come back."""
WITHIN_S = 1500.0
GIVEN_UP_M = 1e3


class Around(NamedTuple):
    """In what a vehicle moves."""

    wind_m_s: float = 0.0
    waves_m: float = 0.0
    current_m_s: float = 0.0
    has_plain_gps: bool = False

    def said(self) -> str:
        """In words."""
        parts = [f"wind {self.wind_m_s:g} m/s"] if self.wind_m_s else []
        parts += [f"waves {self.waves_m:g} m"] if self.waves_m else []
        parts += [f"current {self.current_m_s:g} m/s"] if self.current_m_s else []
        parts += ["metre-level fixes"] if self.has_plain_gps else []
        return ", ".join(parts) or "calm"


class Row(NamedTuple):
    """One vehicle."""

    platform: str
    rough: Around
    straight_m: tuple[float, float]
    """What the RMS beside straight legs must stay below, calm and rough."""
    miss_m: tuple[float, float]
    """What the farthest miss of a waypoint must stay below."""
    mission: str = "survey"


ROWS = (
    Row("rover", Around(has_plain_gps=True), straight_m=(0.1, 4.0), miss_m=(0.3, 5.0)),
    Row("boat", Around(wind_m_s=6.0, waves_m=0.3, current_m_s=0.3), straight_m=(0.5, 0.8), miss_m=(1.0, 2.5)),
    Row("auv", Around(current_m_s=0.2), straight_m=(4.0, 5.0), miss_m=(6.0, 8.0)),
    Row("rov", Around(waves_m=0.3, current_m_s=0.1), straight_m=(4.0, 5.0), miss_m=(6.0, 8.0)),
    Row("pelican_rtk", Around(wind_m_s=6.0), straight_m=(0.2, 0.3), miss_m=(0.4, 0.6)),
)


class Way(NamedTuple):
    """What was asked for and what was done, on the map."""

    state: str
    flown: list[Vector3]
    asked: list[Vector3]


async def _go(row: Row, around: Around, seed: int) -> Way:
    wind = gusty(around.wind_m_s, from_deg=270.0) if around.wind_m_s else CALM
    plan = FlightPlan(
        mission=row.mission,
        platform=row.platform,
        seed=seed,
        wind=wind,
        waves_m=around.waves_m,
        current_m_s=around.current_m_s,
        is_plain_gps=around.has_plain_gps,
    )
    async with Flight(plan) as flight:
        path = RequestedPath(flight.exchange, flight.name)
        end = await flight.await_end(await flight.upload_and_start(), WITHIN_S)
        asked = path.flights[0]
        end_s = math.inf if asked.end_s is None else asked.end_s
        flown = [sample.position_ned_m for sample in flight.samples if asked.start_s <= sample.t_s <= end_s]
    return Way(end.state, flown, [flown[0], *asked.polyline_ned_m[1:]])


def measured(row: Row, around: Around, seed: int) -> dict[str, Any]:
    """The figures of one run."""
    way = run_virtual(_go(row, around, seed))
    misses = [min(math.dist(at[:2], corner[:2]) for at in way.flown) for corner in way.asked[1:]]
    legs = [leg for leg in pairwise(way.asked) if math.dist(leg[0][:2], leg[1][:2]) > 2.0 * CORNER_M]
    beside = [
        min((abs(off_m) for leg in legs for off_m, on_m, length_m in [_beside(at, *leg)] if _is_straight(on_m, length_m)), default=None)
        for at in way.flown
    ]  # fmt: skip
    straight = [off_m for off_m in beside if off_m is not None and off_m < GIVEN_UP_M]
    return {
        "state": way.state,
        "straight_m": math.sqrt(fmean(off_m**2 for off_m in straight)),
        "miss_m": max(misses),
    }


def _is_straight(on_m: float, length_m: float) -> bool:
    return CORNER_M < on_m < length_m - CORNER_M


def _beside(at: Vector3, begin: Vector3, end: Vector3) -> tuple[float, float, float]:
    """How far beside a leg a place is, how far along it, and how long the leg is."""
    north, east = end[0] - begin[0], end[1] - begin[1]
    length_m = math.hypot(north, east)
    n, e = at[0] - begin[0], at[1] - begin[1]
    return (e * north - n * east) / length_m, (n * north + e * east) / length_m, length_m


def picture(row: Row) -> str:
    """The name of a vehicle's picture."""
    return f"{row.platform}_rough.svg"


def draw(row: Row) -> str:
    """Draws the first seed's way in rough conditions, beside the page."""
    way = run_virtual(_go(row, row.rough, SEEDS[0]))
    title = f"{row.platform}: {row.rough.said()}"
    plot_path(way.flown, way.asked, Path(PAGES / picture(row)), home=way.flown[0], title=title)
    return title


def vehicle_accuracy(progress: Progress) -> list[Figure]:
    """Two rows of figures a vehicle."""
    figures: list[Figure] = []
    for row in ROWS:
        for index, around in enumerate((Around(), row.rough)):
            runs = [
                progress.part(f"{row.platform} {around.said()} {seed}", partial(measured, row, around, seed))
                for seed in SEEDS
            ]
            done = sum(run["state"] == "done" for run in runs)
            worst, miss = max(run["straight_m"] for run in runs), max(run["miss_m"] for run in runs)
            mean = fmean(run["straight_m"] for run in runs)
            name = f"{row.platform}, {around.said()}"
            figures += [
                Figure(f"{name}: missions done", f"{done} of {len(runs)}", "all", done == len(runs)),
                Figure(
                    f"{name}: RMS beside straight legs, worst seed (mean)",
                    f"{worst:.2f} m ({mean:.2f} m)",
                    f"≤ {row.straight_m[index]:g} m",
                    worst <= row.straight_m[index],
                ),
                Figure(
                    f"{name}: farthest miss of a waypoint",
                    f"{miss:.2f} m",
                    f"≤ {row.miss_m[index]:g} m",
                    miss <= row.miss_m[index],
                ),
            ]
        progress.say(progress.part(f"picture {row.platform}", partial(draw, row)))
    return figures


BARS = (
    Bar(
        "vehicle-accuracy",
        "How well each vehicle keeps its way",
        "One mission file, `survey`, is carried out by each vehicle with its own platform file, calm and rough, by the true "
        "position. Straight is what lies more than 8 m along a leg from both its ends; a miss is the nearest that the vehicle "
        "came to a waypoint. The pictures show the first seed in rough conditions.",
        vehicle_accuracy,
        seeds="1 to 10",
        pictures=tuple(picture(row) for row in ROWS),
    ),
)
