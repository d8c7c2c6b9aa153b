"""Runs a search to its end, shrinks what it finds, and reports: what `gloc3 prove` and the campaign page run."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from gloc3.clock import Clock
from gloc3_sitl.faults.fault_text import parse
from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.found import FoundCase, distinct, write_found
from gloc3_sitl.proof.invariant import BrokenInvariant
from gloc3_sitl.proof.search import Invariants, Search, flying
from gloc3_sitl.proof.shrink import MOST_FLIGHTS, Shrinker
from gloc3_sitl.proof.standard_invariants import all_invariants
from gloc3_sitl.proof.static_flights import prove_case
from gloc3_sitl.proof.static_proof import OTHER_SOURCES

FOUND: Final = "found"
ON_THE_GROUND: Final = "before the start"
Report = Callable[["SearchProgress"], None]


class SearchProgress(msgspec.Struct, kw_only=True):
    """How far a search is, and in the end what it has found."""

    mission: str
    platform: str
    seed: int
    flights: int = 0
    simulated_s: float = 0.0
    reached: dict[str, int] = {}
    """Distinct things that were reached, by kind: events, states, modes…"""
    covered: dict[str, dict[str, int]] = {}
    """Flights by kind of fault and phase in which it began."""
    phases: list[str] = []
    states: dict[str, int] = {}
    """Flights by the mission's state at the end."""
    broken: dict[str, int] = {}
    """Flights by broken invariant."""
    refused: int = 0
    rough: int = 0
    """Flights in wind, waves or a current from their beginning."""
    replaced: int = 0
    """Flights whose only fault is the death of a component that a standby or other sources stand in for."""
    replaced_done: int = 0
    """Those of them whose mission was done."""
    without_faults: list[BrokenInvariant] = []
    """Broken without any fault; not judged in the flights with faults, where they would hide everything else."""
    found: list[FoundCase] = []
    """The smallest flights, one of each kind."""
    shrinking: str = ""
    search_s: float = 0.0
    """Wall time of the search, before shrinking; on one machine only a measure."""
    processor_s: float = 0.0
    """What its flights have cost, in seconds of one processor; those of an interrupted run before are not counted."""


class SearchLimits(msgspec.Struct, frozen=True, kw_only=True):
    """When a search ends."""

    flights: int | None = None
    seconds: float | None = None
    """Of wall time, before shrinking."""
    stops_at_first: bool = False
    most_found: int = 10
    shrink_flights: int = MOST_FLIGHTS


def run_search(
    base: FlightCase, limits: SearchLimits, jobs: int, out: Path | None, report: Report, kinds: Invariants | None = None
) -> SearchProgress:
    """Searches, shrinks, writes.

    Args:
        base: what is flown, without faults.
        limits: when it ends.
        jobs: processes.
        out: the folder for state and findings; None keeps nothing.
        report: is told after each round.
        kinds: the invariants; None for all that are installed.

    Raises:
        Gloc3Error: the mission cannot be flown, or the folder holds another search.
    """
    progress = SearchProgress(mission=base.mission, platform=base.platform, seed=base.seed)
    begin_s = Clock.cost_s()
    with flying(jobs) as fly:
        search = Search(base, fly, all_invariants() if kinds is None else kinds, out)
        by_name = {kind.name: kind for kind in search.kinds}
        search.begin()
        replaced = _replaced(search)
        progress.without_faults = list(search.broken_at_rest)
        progress.search_s = round(Clock.cost_s() - begin_s, 1)
        _count(progress, search, replaced)
        report(progress)
        while not _is_over(progress, limits, Clock.cost_s() - begin_s):
            search.round()
            progress.search_s = round(Clock.cost_s() - begin_s, 1)
            _count(progress, search, replaced)
            report(progress)
        pairs = [(one.broken[0].invariant, one.case) for one in search.found]
        at_rest = [(one.invariant, base) for one in search.broken_at_rest]
        seen: set[str] = set()
        for invariant, case in [*at_rest, *distinct(pairs, limits.most_found)]:
            progress.shrinking = f"{invariant}: {' '.join(case.faults) or 'no fault'}"
            report(progress)
            shrunk = Shrinker(by_name[invariant], fly, limits.shrink_flights).shrink(case)
            if shrunk.case.line() + invariant in seen:
                continue
            seen.add(shrunk.case.line() + invariant)
            folder = None if out is None else out / FOUND / f"{len(progress.found) + 1:02d}-{invariant}"
            written = write_found(shrunk.case, by_name[invariant], folder, shrunk.flights)
            if written is not None:
                progress.found.append(written)
    progress.shrinking = ""
    report(progress)
    return progress


def _is_over(progress: SearchProgress, limits: SearchLimits, took_s: float) -> bool:
    if limits.stops_at_first and (progress.broken or progress.without_faults):
        return True
    if limits.flights is not None and progress.flights >= limits.flights:
        return True
    return limits.seconds is not None and took_s >= limits.seconds


def _count(progress: SearchProgress, search: Search, replaced: frozenset[str]) -> None:
    """Brings the figures up to date."""
    new = search.flights[progress.flights :]
    progress.flights = len(search.flights)
    progress.processor_s = round(search.processor_s, 1)
    progress.phases = [ON_THE_GROUND, *(target for _, target in search.course.phases)]
    progress.reached = dict(sorted(Counter(word.partition(" ")[0] for word in search.reached).items()))
    states, broken = Counter(progress.states), Counter(progress.broken)
    for one in new:
        progress.simulated_s = round(progress.simulated_s + one.ended_s, 1)
        progress.refused += bool(one.refused)
        progress.rough += any((one.case.wind_m_s, one.case.waves_m, one.case.current_m_s))
        begun = [fault for fault in map(parse, one.case.faults) if not one.refused and fault.begin_s < one.ended_s]
        is_replaced = bool(begun) and _dead(one.case) in replaced
        progress.replaced += is_replaced
        progress.replaced_done += is_replaced and one.state == "done"
        states[one.state or "not started"] += 1
        broken.update({found.invariant: 1 for found in one.broken})
        for fault in begun:
            kind = fault.what.partition(":")[0].partition("=")[0]
            phase = _phase(search, fault.begin_s)
            row = progress.covered.setdefault(kind, {})
            row[phase] = row.get(phase, 0) + 1
    progress.states, progress.broken = dict(sorted(states.items())), dict(sorted(broken.items()))


def _replaced(search: Search) -> frozenset[str]:
    """The components that a standby or other sources stand in for, by the static proof."""
    return frozenset(
        cell.component for cell in prove_case(search.base).cells if cell.by or OTHER_SOURCES in cell.answer
    )


def _dead(case: FlightCase) -> str:
    """The component whose death is the only fault of a flight; empty where there is another, or none."""
    if len(case.faults) != 1 or case.wind_m_s or case.waves_m or case.current_m_s:
        return ""
    kind, _, component = parse(case.faults[0]).target.partition(":")
    return component if kind in ("crash", "hang") else ""


def _phase(search: Search, t_s: float) -> str:
    """The action that runs at a time of the fault-free flight."""
    found = ON_THE_GROUND
    for begin_s, target in search.course.phases:
        if begin_s <= t_s:
            found = target
    return found
