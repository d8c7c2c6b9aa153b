"""Bar: missions at random, through the checker and the executor in virtual time."""

import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any

from tests.common.mission.at_random.fly import CALM, TROUBLED, Command
from tests.common.mission.at_random.judge import case, fly, judge, steps_and_targets
from tests.common.mission.at_random.mutants import MUTANTS, broken
from tests.evidence.page import Bar, Figure, Progress

MISSIONS = 10_000
PART = 250
STEERED = 60
"""So many seeds are steered at every step, as far as their missions may fly."""
VERBS = ("pause", "resume", "skip", "abort")


def run(progress: Progress) -> Sequence[Figure]:
    """Draws, checks, flies and judges them all, on all cores."""
    total: Counter[str] = Counter()
    wrong: list[str] = []
    parts: dict[str, Callable[[], Any]] = {f"from {first}": partial(_part, first) for first in range(0, MISSIONS, PART)}
    parts |= {f"steered {seed}": partial(_steered, seed) for seed in range(STEERED)}
    for key, part in _in_parallel(progress, parts):
        total.update(part["counts"])
        wrong += part["wrong"]
        progress.report(f"{key}: {len(wrong)} with something wrong so far")
    found = {mutant.name: progress.part(mutant.name, lambda m=mutant: _found(m)) for mutant in MUTANTS}  # type: ignore[misc]
    flaws = {name: count for name, count in total.items() if name.startswith("flaw: ")}
    caught = sum(first is not None for first in found.values())
    return [
        Figure("missions drawn", f"{total['drawn']:,}", f"{MISSIONS:,}", total["drawn"] == MISSIONS),
        Figure("accepted and flown", f"{total['flown']:,}"),
        Figure("refused, nothing being wrong with them on purpose", f"{total['refused']:,}"),
        Figure("drawn with a flaw, of 19 kinds and more", f"{sum(flaws.values()):,}"),
        Figure("of these accepted", f"{total['accepted']:,}", "0", not total["accepted"]),
        Figure("restarts of the executor from its disk", f"{total['restarts']:,}", "≥ 1,000", total["restarts"] >= 1000),
        Figure("commands of operators at random", f"{total['commands']:,}"),
        *(Figure(f"flights that end {state}", f"{total[f'state: {state}']:,}") for state in ("done", "failed", "aborted", "skipped")),
        Figure("flights steered, each at another step, half of them in trouble already", f"{total['steered']:,}", "≥ 5,000", total["steered"] >= 5000),
        Figure("missions and flights with a broken rule, or refused without reason and place", str(len(wrong)), "0", not wrong),
        *(Figure("such as", one.replace("|", "\\|")) for one in wrong[:5]),
        Figure("executors with one line broken that the observer finds", f"{caught} of {len(MUTANTS)}", "all", caught == len(MUTANTS)),
        *(Figure(f"found: {name}", f"mission {first}") for name, first in found.items()),
    ]  # fmt: skip


def _in_parallel(progress: Progress, parts: dict[str, Callable[[], Any]]) -> Iterable[tuple[str, dict[str, Any]]]:
    """The results of all parts in their order."""
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        begun = {key: pool.submit(part) for key, part in parts.items() if not progress.knows(key)}
        for key in parts:
            yield key, progress.part(key, lambda key=key: begun[key].result())  # type: ignore[misc]


def _part(first: int) -> dict[str, Any]:
    counts: Counter[str] = Counter()
    wrong = []
    for seed in range(first, first + PART):
        one = judge(seed)
        counts["drawn"] += 1
        counts["flown"] += one.is_flown
        counts["refused"] += not one.is_flown and not one.flaw
        counts["accepted"] += one.is_flown and bool(one.flaw)
        counts["restarts"] += one.restarts
        counts["commands"] += one.commands
        counts[f"state: {one.state}"] += one.is_flown
        counts[f"flaw: {one.flaw}"] += bool(one.flaw)
        wrong += [f"{seed}: {one.wrong[0]}"] if one.wrong else []
    return {"counts": dict(counts), "wrong": wrong}


def _steered(seed: int) -> dict[str, Any]:
    """Each verb at each step, on every task, action and the mission by turns."""
    steered, weather = case(seed), TROUBLED if seed % 2 else CALM
    steps, targets = steps_and_targets(steered, weather)
    wrong, flights = [], 0
    for step in range(1, steps):
        for index, verb in enumerate(VERBS):
            target = targets[(step + index) % len(targets)]
            one = fly(steered, weather, (Command(step, verb, target),))
            flights += 1
            wrong += [f"{seed}, {verb} {target} at step {step}: {one.wrong[0]}"] if one.wrong else []
    return {"counts": {"steered": flights}, "wrong": wrong}


def _found(mutant: Any) -> int | None:
    with broken(mutant):
        return next((seed for seed in range(mutant.seed, mutant.seed + 500) if judge(seed).wrong), None)


BARS = (
    Bar(
        "random-missions",
        "10,000 random missions break no rule of the mission language",
        "Missions are generated at random, three of four valid, with loops, guards, definitions, patterns, paths "
        "flown by the autopilot, silences and contingencies; each of the others contains one error. They are checked "
        "and flown in virtual time in five conditions: calm; components that fail, refuse, fall silent and are late; "
        "restarts at any moment, from what is on disk; lost links, low batteries, lost poses, obstacles, lost "
        "components, pilots and emergencies, which policies and contingencies answer; and all of it with operators "
        "who act at random. An observer that knows the file and the log of the flight, but not the executor, judges "
        "order, claims, motion ownership, fence, deadlines, guards, loops, policies, the ends of contingencies, "
        "attempts, what is on disk before it is reported or begun, and that everything ends. Breaking single lines of "
        "the executor shows that the observer would notice.",
        run,
        seeds="0 to 9,999",
    ),
)
