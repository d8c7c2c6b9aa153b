"""Thousands of flights with faults at any moment, on every platform, judged by what must always hold."""

import os
import re
import subprocess
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final, NamedTuple

import msgspec
from tests.evidence.page import ROOT, SCRATCH, Bar, Figure, Progress
from tests.evidence.static_proof import AUTOPILOTS, FIELD, PERCEIVED, SMALL_FIELD

from gloc3.mission.templates import mission_from
from gloc3.platform.reader import load_platform
from gloc3_sitl.cli.prove_table import shown
from gloc3_sitl.proof.campaign import SearchLimits, run_search
from gloc3_sitl.proof.case import FlightCase

FLIGHTS: Final = 300
ROUGH: Final = 0.25
DONE: Final = 0.95
PART: Final = 112
"""Flights of one search: a part of the page that is not flown again after an interruption."""
FOUND: Final = ROOT / "tests/proof/found_cases.jsonl"


class ShorterTemplate(NamedTuple):
    """A mission template with less to fly, so that a flight takes a minute or two."""

    name: str
    template: str
    what: str
    """A pattern of what is otherwise."""
    by: str


SHORT: Final = (
    ShorterTemplate("set off and land", "transit", r"to_m: \[\[.*?\]\]", "to_m: [[6, 0]]"),
    ShorterTemplate("way", "transit", "mission: transit", "mission: way"),
    ShorterTemplate(
        "survey",
        "survey",
        FIELD,
        "area_m: [[5, 5], [15, 5], [15, 11], [5, 11]], spacing_m: 3",
    ),
)
WINGED: Final = (
    ShorterTemplate("line", "mapping", FIELD, SMALL_FIELD),
    ShorterTemplate(
        "way", "mapping", FIELD, "area_m: [[300, 100], [500, 100], [500, 340], [300, 340]], spacing_m: 220"
    ),
    ShorterTemplate(
        "survey", "mapping", FIELD, "area_m: [[300, 100], [700, 100], [700, 340], [300, 340]], spacing_m: 220"
    ),
)
INDOORS: Final = (
    SHORT[0],
    ShorterTemplate("away and back", "transit", r"to_m: \[\[.*?\]\]", "to_m: [[6, 0], [0, 0]]"),
    ShorterTemplate("across", "transit", r"to_m: \[\[.*?\]\]", "to_m: [[6, 0], [3, 3]]"),
)
PLATFORMS: Final = ("pelican_rtk", "copter", "boat", "rover", "auv", "rov", "submarine", "plane", "vtol")
PHASES: Final = {
    "before the start": "before",
    "away": "set-off",
    "way": "way",
    "area": "survey",
    "field": "survey",
    "sweep": "survey",
    "back": "landing",
    "depart": "set-off",
    "recover": "landing",
}
"""The tasks of these missions as phases of the table."""


def missions(platform: str) -> list[FlightCase]:
    """The missions of a platform, without faults; each search has seeds of its own."""
    loaded = load_platform(platform)
    found = []
    given: Sequence[ShorterTemplate] = WINGED if loaded.limits.turn_radius_m else SHORT
    given = INDOORS if platform in PERCEIVED else given
    if platform == "hummingbird":
        given = INDOORS[:2]
        found.append(FlightCase(mission="inspection", platform=platform, seed=2000))
    for number, one in enumerate(given):
        text = mission_from(one.template, loaded, f"{platform}.mission.schema.json")
        text, count = re.subn(one.what, one.by, text)
        assert count == 1, f"{one.template} has {count} of {one.what}"
        case = FlightCase(mission=f"{one.name}.yaml", platform=platform, text=text, seed=1000 * number)
        autopilot = "ardupilot" if platform == "pelican_rtk" and number == 1 else AUTOPILOTS.get(platform, "")
        found.append(msgspec.structs.replace(case, autopilot=autopilot))
    return found


def _key(base: FlightCase) -> str:
    return f"{base.mission.removesuffix('.yaml')} on {base.platform}" + (
        f" ({base.autopilot})" if base.autopilot else ""
    )


def search(basis: str, base: FlightCase, flights: int = PART) -> dict[str, Any]:
    """One search, on all cores, which goes on where it was interrupted."""
    folder = SCRATCH / "campaign" / basis / _key(base).replace(" ", "-")
    with shown(flights) as report:
        found = run_search(base, SearchLimits(flights=flights), os.cpu_count() or 1, folder, report)
    return {
        "flights": found.flights,
        "rough": found.rough,
        "hours": found.simulated_s / 3600.0,
        "states": found.states,
        "broken": found.broken,
        "covered": found.covered,
        "replaced": [found.replaced_done, found.replaced],
        "without_faults": [str(one).strip() for one in found.without_faults],
        "found": [f"{one.broken.invariant}: `{one.command}`" for one in found.found],
    }


class Totals:
    """What all searches of a platform add up to."""

    def __init__(self) -> None:
        self.flights = 0
        self.missions: Counter[str] = Counter()
        self.broken: Counter[str] = Counter()
        self.states: Counter[str] = Counter()
        self.covered: dict[str, Counter[str]] = {}
        self.hours, self.rough, self.done, self.replaced = 0.0, 0, 0, 0
        self.found: list[Figure] = []

    def add(self, base: FlightCase, part: dict[str, Any]) -> None:
        """Adds a search."""
        self.flights += part["flights"]
        self.missions[base.mission.removesuffix(".yaml")] += part["flights"]
        self.hours, self.rough = self.hours + part["hours"], self.rough + part["rough"]
        self.states.update(part["states"])
        self.broken.update(part["broken"])
        self.done, self.replaced = self.done + part["replaced"][0], self.replaced + part["replaced"][1]
        for fault, phases in part["covered"].items():
            for phase, count in phases.items():
                self.covered.setdefault(fault, Counter())[PHASES.get(phase.partition(".")[0], phase)] += count
        self.found += [Figure(f"broken: {_key(base)}", one, "none", False) for one in part["found"]]
        self.found += [Figure(f"without a fault: {_key(base)}", one, "none", False) for one in part["without_faults"]]


def judge(platform: str) -> Callable[[Progress], Sequence[Figure]]:
    """What gives the figures of a platform."""

    def run(progress: Progress) -> Sequence[Figure]:
        totals, bases = Totals(), missions(platform)
        for number, base in enumerate(bases, start=1):
            totals.add(base, progress.part(_key(base), partial(search, progress.basis, base)))
            broken = sum(totals.broken.values())
            progress.report(
                f"{_key(base)} is done: {number} of {len(bases)}, {totals.flights} flights, {broken} broken"
            )
        return [*_figures(totals, platform), *_coverage(totals), *totals.found, *mended(platform)]

    return run


def _figures(totals: Totals, platform: str) -> Iterator[Figure]:
    share = totals.done / totals.replaced if totals.replaced else 1.0
    rough = totals.rough / totals.flights
    yield Figure("flights", f"{totals.flights:,}", f"≥ {FLIGHTS:,}", totals.flights >= FLIGHTS)
    yield Figure("hours flown", f"{totals.hours:.1f}")
    yield Figure("by mission", ", ".join(f"{count} {name}" for name, count in totals.missions.items()))
    yield Figure("in wind, waves or a current", f"{100.0 * rough:.0f} %", f"≥ {100.0 * ROUGH:.0f} %", rough >= ROUGH)
    for state, count in sorted(totals.states.items()):
        yield Figure(f"mission {state} at the end", str(count))
    yield Figure("flights that break an invariant", str(sum(totals.broken.values())), "0", not totals.broken)
    for name, count in sorted(totals.broken.items()):
        yield Figure(f"… {name}", str(count), "0", False)
    yield Figure(
        "done although a component died that something stands in for",
        f"{totals.done} of {totals.replaced}",
        f"≥ {100.0 * DONE:.0f} %",
        share >= DONE,
    )


def _coverage(totals: Totals) -> Iterator[Figure]:
    """Faults by kind and the phase in which they begin."""
    for fault, phases in sorted(totals.covered.items()):
        yield Figure(f"faults: {fault}", ", ".join(f"{count} {name}" for name, count in phases.items()))


def mended(platform: str) -> list[Figure]:
    """What was found on the way: each case of a platform that is a test now, with the commit that brought it."""
    blamed = ["git", "blame", "--porcelain", "--", str(FOUND)]
    lines = subprocess.run(blamed, cwd=ROOT, check=True, capture_output=True, text=True).stdout.splitlines()
    subjects: dict[str, str] = {}
    figures, commit = [], ""
    for line in lines:
        if line.startswith("\t"):
            case = msgspec.json.decode(line[1:], type=FlightCase)
            if case.platform == platform:
                figures.append(Figure("found and mended", f"`{case.command()}`: {commit[:8]} {subjects[commit]}"))
        elif line.startswith("summary "):
            subjects[commit] = line.removeprefix("summary ")
        elif len(word := line.split()[0]) == 40:
            commit = word
    return figures


BARS = tuple(
    Bar(
        f"campaign-{platform}",
        f"Faults at random moments of a flight break no invariant: {platform}",
        "`gloc3 prove` flies missions with one to three faults at a time, drawn from everything "
        "that can go wrong, at any moment, in rough weather (which moves all but the rover) and calm, and judges each "
        "flight by its invariants "
        "([proof](../proof.md)). The missions are shortened templates of `gloc3 mission new`: depart, fly 6 m and "
        "land; a path of three waypoints; a survey of three lines; for fixed wings, fields of one or two lines. "
        "Pelican and hummingbird, which fly on what their cameras see, stay in the hold: 6 m away, across the hold, away and "
        "back, or the example `inspection`. A flight that "
        "breaks an invariant is shrunk, and is listed below with the command that flies it.",
        judge(platform),
        seeds="0, 1000 and 2000, and from each on 20 of the flights",
    )
    for platform in (*PLATFORMS, *PERCEIVED)
)
