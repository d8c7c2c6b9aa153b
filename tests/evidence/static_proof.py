"""For every component and action: who takes over or which policy flies if it dies, by the files alone, and in flight."""

import os
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import msgspec
from tests.evidence.page import Bar, Figure, Progress

from gloc3.errors import Refused
from gloc3.mission.templates import mission_from, templates
from gloc3.platform.bases import platform_files
from gloc3.platform.reader import load_platform
from gloc3_sitl.flight.mission_file import read_mission_file
from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.search import flying
from gloc3_sitl.proof.static_flights import FlownCell, distinct_cells, fly_cells, prove_case
from gloc3_sitl.proof.static_proof import StaticCell
from gloc3_sitl.proof.trial import fly_case

SHOWN: Final = 5
AUTOPILOTS: Final = {"copter": "ardupilot"}
"""Where the platform's file fits another simulated autopilot than the vehicle's usual one."""
FIELD: Final = r"area_m: \[\[.*?\]\], spacing_m: [0-9.]+"
SMALL_FIELD: Final = "area_m: [[300, 100], [500, 100], [500, 300], [300, 300]], spacing_m: 400"
"""For what flies on wings: one line of the template's field."""

PERCEIVED: Final = ("pelican", "hummingbird")
"""Fly on what their cameras see, which takes twenty times as long to simulate."""
ROUNDS: Final = ("times: 10", "times: 2")
"""Of the patrol that they fly instead of the template's."""


def bases(platform: str) -> list[FlightCase]:
    """The flights of the templates that a platform can fly, without faults, the shortest first."""
    found: list[tuple[float, FlightCase]] = []
    loaded = load_platform(platform)
    for template in templates():
        try:
            text = mission_from(template, loaded, f"{platform}.mission.schema.json")
        except Refused:
            continue
        text = re.sub(FIELD, SMALL_FIELD, text) if loaded.limits.turn_radius_m else text
        text = text.replace(*ROUNDS) if platform in PERCEIVED else text
        autopilot = AUTOPILOTS.get(platform, "")
        base = FlightCase(mission=f"{template}.yaml", platform=platform, autopilot=autopilot, text=text)
        with TemporaryDirectory() as folder:
            duration_s = read_mission_file(base.file(Path(folder)), loaded, Path(folder)).duration_s
        found.append((duration_s, base))
    return [base for _, base in sorted(found, key=lambda one: one[0])]


def without_fault(base: FlightCase) -> dict[str, Any]:
    """How a mission ends in which no component dies."""
    result = fly_case(base, is_stopping=False)
    broken = [str(one).strip() for one in result.broken]
    return {"state": result.state or result.refused or result.reason, "broken": broken}


def _key(base: FlightCase, cell: StaticCell) -> str:
    return f"{base.mission} {cell.component} {cell.phase}"


def flown(progress: Progress, base: FlightCase, cells: Sequence[StaticCell]) -> list[FlownCell]:
    """The cells in flight: those that are known from a run before, and the others, on all cores."""
    unknown = [cell for cell in cells if not progress.knows(_key(base, cell))]
    with flying(os.cpu_count() or 1) as fly:
        for one in fly_cells(unknown, base, fly, progress.report) if unknown else ():
            made = msgspec.to_builtins(one)
            progress.part(_key(base, one.cell), lambda made=made: made)  # type: ignore[misc]
    return [msgspec.convert(progress.part(_key(base, cell), dict), FlownCell) for cell in cells]


def judge(platform: str) -> Callable[[Progress], Sequence[Figure]]:
    """What gives the figures of a platform."""

    def run(progress: Progress) -> Sequence[Figure]:
        return _judge(progress, platform)

    return run


def _judge(progress: Progress, platform: str) -> Sequence[Figure]:
    known: dict[tuple[str, ...], StaticCell] = {}
    count, empty, otherwise, at_rest = 0, [], [], []
    missions = bases(platform)
    for base in missions:
        name = base.mission.removesuffix(".yaml")
        proof = prove_case(base)
        count += len(proof.cells)
        empty += [f"{cell.component} in {name} {cell.phase}: {cell.problem}" for cell in proof.cells if cell.problem]
        calm = progress.part(base.mission, partial(without_fault, base))
        at_rest += [f"{name}: {one}" for one in calm["broken"]]
        at_rest += [] if calm["state"] == "done" else [f"{name} is {calm['state']}"]
        cells = distinct_cells(proof.cells, known)
        known |= {cell.signature: cell for cell in cells}
        if calm["state"] == "done":
            wrong = [one for one in flown(progress, base, cells) if one.problem]
            otherwise += [f"`{one.case.command(base.mission)}`: {one.problem}" for one in wrong]
    names = ", ".join(base.mission.removesuffix(".yaml") for base in missions)
    return [
        Figure(f"cells of {names}", str(count)),
        Figure("… without an answer", "; ".join(empty) or "none", "none", not empty),
        Figure("… distinct ones, a flight each", str(len(known))),
        Figure("… broken or not done without any fault", "; ".join(at_rest) or "none", "none", not at_rest),
        Figure("… otherwise in flight than answered", str(len(otherwise)), "0", not otherwise),
        *(Figure("… such as", one) for one in otherwise[:SHOWN]),
        *_answers(list(known.values())),
    ]


def _answers(cells: Sequence[StaticCell]) -> list[Figure]:
    """The answers, a row for each component and answer."""
    shared: dict[tuple[str, str], list[str]] = {}
    for cell in cells:
        shared.setdefault((cell.component, cell.answer), []).append(cell.capability)
    every = len({cell.capability for cell in cells})
    rows = []
    for (component, answer), capabilities in shared.items():
        where = "always" if len(capabilities) == every else "during " + ", ".join(sorted(set(capabilities)))
        rows.append(Figure(f"{component} dies, {where}", answer))
    return rows


BARS = tuple(
    Bar(
        f"static-proof-{platform}",
        f"For every component of {platform} that dies there is an answer, and it holds in flight",
        "For every mission template that the platform can fly (`gloc3 mission new`), every component and every action, the "
        "files say who takes over, or which policy flies, if the component dies for good. "
        "The answers are flown: the component fails in every cycle from one second after the start of the action, every "
        "invariant holds, and the mission continues where that was the answer. Actions of one capability share a flight, "
        "in the shortest of the missions, where the answer for a component is the same; of the field of `mapping` one "
        "line is flown, and of the rounds of `patrol` two by what flies on its cameras. `gloc3 prove MISSION --platform PLATFORM --static --fly` does it for one.",
        judge(platform),
        seeds="0",
    )
    for platform in sorted(platform_files())
)
