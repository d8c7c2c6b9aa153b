"""Thousands of flights with faults at any moment, on every platform, judged by what must always hold."""

import os
from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import Any, Final

from tests.evidence.page import SCRATCH, Bar, Figure, Progress

from gloc3_sitl.proof.campaign import SearchLimits, run_search
from gloc3_sitl.proof.case import FlightCase

FLIGHTS: Final = 3000
A_PLATFORM: Final = 300
WITH_PERCEPTION: Final = 200
DONE: Final = 0.95
PART: Final = 112
"""Flights of one search: a part of the page that is not flown again after an interruption."""
SEARCHES: Final = (
    ("hop", "pelican_rtk", "px4"),
    ("hop", "pelican_rtk", "ardupilot"),
    ("inspection", "pelican_rtk", ""),
    ("survey", "pelican_rtk", ""),
    ("survey", "boat", ""),
    ("survey", "rover", ""),
    ("survey", "auv", ""),
    ("survey", "rov", ""),
    ("mapping", "plane", ""),
)
ROUNDS: Final = 3
"""Searches of each, with seeds of their own."""
PERCEIVED: Final = (("inspection", "pelican"), ("inspection", "hummingbird"))


def _searches() -> list[FlightCase]:
    """All searches, in an order in which every platform comes early."""
    plain = [
        FlightCase(mission=mission, platform=platform, autopilot=autopilot, seed=1000 * turn)
        for turn in range(ROUNDS)
        for mission, platform, autopilot in SEARCHES
    ]
    return plain + [FlightCase(mission=mission, platform=platform, seed=0) for mission, platform in PERCEIVED]


def search(base: FlightCase) -> dict[str, Any]:
    """One search, on all cores."""
    name = f"{base.mission}-{base.platform}-{base.autopilot or 'usual'}-{base.seed}"
    limits = SearchLimits(flights=PART)
    found = run_search(base, limits, os.cpu_count() or 1, SCRATCH / "campaign" / name, lambda _: None)
    return {
        "flights": found.flights,
        "hours": found.simulated_s / 3600.0,
        "states": found.states,
        "broken": found.broken,
        "covered": found.covered,
        "replaced": [found.replaced_done, found.replaced],
        "without_faults": [str(one) for one in found.without_faults],
        "found": [f"{one.broken.invariant}: `{one.command}`" for one in found.found],
    }


def judge(progress: Progress) -> Sequence[Figure]:
    """The figures."""
    flights: Counter[str] = Counter()
    broken: Counter[str] = Counter()
    states: Counter[str] = Counter()
    covered: dict[str, Counter[str]] = {}
    found: list[Figure] = []
    hours, done, replaced = 0.0, 0, 0
    for base in _searches():
        key = f"{base.mission} {base.platform} {base.autopilot} {base.seed}"
        part = progress.part(key, partial(search, base))
        progress.report(f"{key}: {sum(part['broken'].values())} broken")
        flights[base.platform] += part["flights"]
        hours += part["hours"]
        states.update(part["states"])
        broken.update(part["broken"])
        done, replaced = done + part["replaced"][0], replaced + part["replaced"][1]
        for fault, phases in part["covered"].items():
            covered.setdefault(base.platform, Counter())[fault] += sum(phases.values())
        found += [Figure(f"found: {base.mission} on {base.platform}", one) for one in part["found"]]
        found += [Figure(f"without a fault: {base.mission} on {base.platform}", one) for one in part["without_faults"]]
    everything = sum(flights.values())
    perceived = sum(flights[platform] for _, platform in PERCEIVED)
    share = done / replaced if replaced else 0.0
    others = [(platform, count) for platform, count in flights.items() if platform not in dict(PERCEIVED).values()]
    return [
        Figure("flights", f"{everything:,}", f"≥ {FLIGHTS:,}", everything >= FLIGHTS),
        Figure("hours flown", f"{hours:.0f}"),
        *(Figure(f"… {name}", f"{count:,}", f"≥ {A_PLATFORM}", count >= A_PLATFORM) for name, count in others),
        Figure("with the whole perception", str(perceived), f"≥ {WITH_PERCEPTION}", perceived >= WITH_PERCEPTION),
        *(Figure(f"… that end {state}", str(count)) for state, count in sorted(states.items())),
        Figure("flights that break an invariant", str(sum(broken.values())), "0", not broken),
        *(Figure(f"… {name}", str(count), "0", False) for name, count in sorted(broken.items())),
        Figure(
            "done although a component died that something stands in for",
            f"{done} of {replaced} ({100.0 * share:.0f} %)",
            f"≥ {100.0 * DONE:.0f} %",
            share >= DONE,
        ),
        *(
            Figure(f"faults on {platform}", ", ".join(f"{count} {name}" for name, count in sorted(faults.items())))
            for platform, faults in covered.items()
        ),
        *found,
    ]


BARS = (
    Bar(
        "campaign",
        "Flights with faults at any moment",
        "`gloc3 prove` flies missions of every platform with one to three faults at a time, drawn from everything that can go "
        "wrong, at any moment, in rough weather and calm, and judges each flight by its invariants ([proof](../proof.md)). "
        "What breaks one is shrunk, and stands below with the command that flies it.",
        judge,
        seeds="0, 1000 and 2000, and from each on 20 of the flights",
    ),
)
