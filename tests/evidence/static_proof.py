"""For every component and action: who takes over or which policy flies if it dies, by the files alone, and in flight."""

import os
from collections.abc import Sequence
from functools import partial
from typing import Any, Final

from tests.evidence.page import Bar, Figure, Progress

from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.search import flying
from gloc3_sitl.proof.static_flights import fly_cells, prove_case

PAIRS: Final = (
    ("hop", "pelican_rtk"),
    ("patrol", "pelican_rtk"),
    ("inspection", "pelican_rtk"),
    ("survey", "pelican_rtk"),
    ("inspection", "pelican"),
    ("inspection", "hummingbird"),
    ("survey", "boat"),
    ("survey", "rover"),
    ("survey", "auv"),
    ("survey", "rov"),
    ("mapping", "plane"),
)
"""Every installed platform with what it can fly of the examples."""


def prove(mission: str, platform: str, report: Any) -> dict[str, Any]:
    """One platform and mission: the cells, and what was otherwise in flight."""
    base = FlightCase(mission=mission, platform=platform)
    proof = prove_case(base)
    with flying(os.cpu_count() or 1) as fly:
        flown = list(fly_cells(proof, base, fly, report))
    return {
        "cells": len(proof.cells),
        "empty": [f"{cell.component} in {cell.phase}: {cell.problem}" for cell in proof.cells if cell.problem],
        "warnings": [str(one.message) for one in proof.findings if one.is_warning],
        "flown": len(flown),
        "otherwise": [f"`{one.case.command()}`: {one.problem}" for one in flown if one.problem],
    }


def judge(progress: Progress) -> Sequence[Figure]:
    """The figures."""
    figures: list[Figure] = []
    for mission, platform in PAIRS:
        part = progress.part(f"{mission} {platform}", partial(prove, mission, platform, progress.report))
        name = f"{mission} on {platform}"
        figures += [
            Figure(f"{name}: cells", str(part["cells"])),
            Figure("… without an answer", "; ".join(part["empty"]) or "none", "none", not part["empty"]),
            Figure("… flown", str(part["flown"]), str(part["cells"]), part["flown"] == part["cells"]),
            Figure("… otherwise than answered", str(len(part["otherwise"])), "0", not part["otherwise"]),
            *(Figure("… such as", one) for one in part["otherwise"][:5]),
            *(Figure("… that stops with its input", one) for one in part["warnings"]),
        ]
    return figures


BARS = (
    Bar(
        "static-proof",
        "What happens if a component dies",
        "For every component and every action the platform's file and the mission say who takes over, or which policy flies, if the "
        "component dies for good. Each answer is flown: the component fails in every cycle from one second after the action's "
        "begin, every invariant holds, and the mission goes on where that was the answer.",
        judge,
        seeds="0",
    ),
)
