"""How well each vehicle keeps a way: one mission file, calm and rough, over seeds; a vehicle is a row."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from tests.evidence.page import PAGES, Bar, Figure, Progress
from tests.evidence.ways import Around, beside_m, draw, lost, missed_m

SEEDS = range(1, 9)


class Most(NamedTuple):
    """What the figures of a vehicle must stay below, in metres."""

    own_m: float
    """RMS beside straight legs by its own pose: what its guidance leaves."""
    true_m: float
    """The same by the truth: that, and what its pose is off."""
    miss_m: float
    """The farthest true miss of a waypoint."""


class Row(NamedTuple):
    """One vehicle."""

    platform: str
    rough: Around
    most_calm: Most
    most_rough: Most
    mission: str = "survey"
    corner_m: float = 8.0
    """Farther than this along a leg from both its ends it is straight: what turns wide has come back."""


FIX_M = 4.5
"""A plain receiver's error of 1.2 m north and east is less than this 999 times in 1000, on the map."""

ROWS = (
    Row("rover", Around(has_plain_gps=True), Most(0.1, 0.1, 0.2), Most(0.2, FIX_M, FIX_M + 0.5)),
    Row("boat", Around(wind_m_s=6.0, waves_m=0.3, current_m_s=0.3), Most(0.5, 0.5, 1.0), Most(0.6, 0.6, 2.0)),
    Row("auv", Around(current_m_s=0.2), Most(0.1, FIX_M, FIX_M + 0.5), Most(0.3, FIX_M, FIX_M + 0.5)),
    Row("rov", Around(waves_m=0.3, current_m_s=0.1), Most(0.1, FIX_M, FIX_M + 0.5), Most(0.2, FIX_M, FIX_M + 0.5)),
    Row("pelican_rtk", Around(wind_m_s=6.0), Most(0.1, 0.1, 0.25), Most(0.2, 0.2, 0.5)),
    Row("plane", Around(wind_m_s=6.0), Most(2.0, 2.0, 35.0), Most(3.0, 3.0, 40.0), "mapping", 200.0),
)


def measured(row: Row, around: Around, seed: int) -> dict[str, Any]:
    """The figures of one run."""
    way = lost(row.mission, row.platform, around, seed)
    return {
        "state": way.state,
        "own_m": beside_m(way.believed, way.requested, row.corner_m),
        "true_m": beside_m(way.true, way.requested, row.corner_m),
        "miss_m": missed_m(way.true, way.requested),
    }


def picture(row: Row) -> str:
    """The name of a vehicle's picture."""
    return f"{row.platform}_rough.svg"


def drawn(row: Row) -> str:
    """Draws the first seed's way in rough conditions, beside the page."""
    title = f"{row.platform}: {row.rough.reported()}"
    draw(lost(row.mission, row.platform, row.rough, SEEDS[0]), Path(PAGES / picture(row)), title)
    return title


def vehicle_accuracy(progress: Progress) -> list[Figure]:
    """Four figures a vehicle, calm and rough."""
    figures: list[Figure] = []
    for row in ROWS:
        for around, most in ((Around(), row.most_calm), (row.rough, row.most_rough)):
            runs = []
            for seed in SEEDS:
                key = f"{row.platform} {around.reported()} {seed}"
                progress.report(key)
                runs.append(progress.part(key, partial(measured, row, around, seed)))
            figures += _figures(f"{row.platform}, {around.reported()}", runs, most)
        progress.report(progress.part(f"picture {row.platform}", partial(drawn, row)))
    return figures


def _figures(name: str, runs: Sequence[dict[str, Any]], most: Most) -> list[Figure]:
    done = sum(run["state"] == "done" for run in runs)
    text = {
        "own_m": "RMS beside straight legs by its own pose, worst seed (mean)",
        "true_m": "the same by the true position",
        "miss_m": "farthest true miss of a waypoint",
    }
    figures = [Figure(f"{name}: missions done", f"{done} of {len(runs)}", "all", done == len(runs))]
    for key, words in text.items():
        values = [run[key] for run in runs]
        worst, bar = max(values), getattr(most, key)
        figures.append(
            Figure(f"{name}: {words}", f"{worst:.2f} m ({fmean(values):.2f} m)", f"≤ {bar:g} m", worst <= bar)
        )
    return figures


BARS = (
    Bar(
        "vehicle-accuracy",
        "Each vehicle stays within its bound of the path, in calm and rough conditions",
        "Each vehicle carries out one mission file, `survey`, with its own platform file, calm and rough; the plane, "
        "which turns too wide for it, flies `mapping`. *By its own pose* shows the error of guidance and control. The "
        "true position includes the error of the pose: AUV and ROV dive from plain satellite fixes, whose slow error "
        "of 1.2 m north and east stays for the whole path, and so does the rover's in rough conditions. 999 of 1000 "
        f"such errors are below {FIX_M:g} m. The straight part of a leg is more than 8 m from both its ends (plane: "
        "200 m). A miss is the smallest distance of the vehicle to a waypoint. The pictures show the first seed in "
        "rough conditions.",
        vehicle_accuracy,
        seeds="1 to 8",
        pictures=tuple(picture(row) for row in ROWS),
    ),
)
