"""Bar: missions at random, through the checker and the executor in virtual time."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

from tests.common.mission.at_random.fly import Command
from tests.common.mission.at_random.judge import judge, steps_and_targets
from tests.common.mission.at_random.mutants import MUTANTS, broken
from tests.evidence.page import Bar, Figure, Progress

MISSIONS = 10_000
PART = 500
STEERED = 60
"""So many seeds are steered at every step, as far as their missions may fly."""
VERBS = ("pause", "resume", "skip", "abort")


def run(progress: Progress) -> Sequence[Figure]:
    """Draws, checks, flies and judges them all."""
    total: Counter[str] = Counter()
    wrong: list[str] = []
    for first in range(0, MISSIONS, PART):
        part = progress.part(f"from {first}", lambda first=first: _part(first))  # type: ignore[misc]
        total.update(part["counts"])
        wrong += part["wrong"]
        progress.say(f"{first + PART} missions, {len(wrong)} with something wrong")
    steered: Counter[str] = Counter()
    for seed in range(STEERED):
        part = progress.part(f"steered {seed}", lambda seed=seed: _steered(seed))  # type: ignore[misc]
        steered.update(part["counts"])
        wrong += part["wrong"]
        progress.say(f"{seed + 1} missions steered at every step, {len(wrong)} with something wrong")
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
        Figure("flights steered, each at another step", f"{steered['flights']:,}", "≥ 5,000", steered["flights"] >= 5000),
        Figure("missions and flights with a broken rule, or refused without reason and place", str(len(wrong)), "0", not wrong),
        *(Figure("such as", one.replace("|", "\\|")) for one in wrong[:5]),
        Figure("executors with one line broken that the observer finds", f"{caught} of {len(MUTANTS)}", "all", caught == len(MUTANTS)),
        *(Figure(f"found: {name}", f"mission {first}") for name, first in found.items()),
    ]  # fmt: skip


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
    steps, targets = steps_and_targets(seed)
    wrong, flights = [], 0
    for step in range(1, steps):
        for index, verb in enumerate(VERBS):
            target = targets[(step + index) % len(targets)]
            one = judge(seed, (Command(step, verb, target),))
            flights += 1
            wrong += [f"{seed}, {verb} {target} at step {step}: {one.wrong[0]}"] if one.wrong else []
    return {"counts": {"flights": flights}, "wrong": wrong}


def _found(mutant: Any) -> int | None:
    with broken(mutant):
        return next((seed for seed in range(mutant.seed, mutant.seed + 500) if judge(seed).wrong), None)


BARS = (
    Bar(
        "random-missions",
        "10,000 missions at random",
        "Missions are drawn at random, three of four right, with everything that the language has, the others with one "
        "thing wrong; checked; and flown in virtual time in four kinds of weather: calm; components that fail, refuse, fall "
        "silent and are late; restarts at any moment, from what is on disk; and all of it with conditions, faults, pilots, "
        "emergencies and operators at random. An observer that knows the file and the log of the flight, and nothing of the "
        "executor, judges order, claims, owner of motion, fence, deadlines, policies, attempts, what is on disk before it is "
        "told or begun, and that all comes to an end. Breaking the executor in single lines shows that it would notice.",
        run,
        seeds="0 to 9,999",
    ),
)
