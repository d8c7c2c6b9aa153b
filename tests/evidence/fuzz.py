"""Coverage-guided fuzzing of every parser that a stranger's bytes or files reach."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Final

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.fuzz.__main__ import Fuzzed, fuzz
from tests.fuzz.target import FOUND
from tests.fuzz.targets import TARGETS

SECONDS: Final = 60
AT_LEAST: Final = 25
"""Parsers of the stack."""


def judge(progress: Progress) -> Sequence[Figure]:
    """One figure for each target."""
    rows, executions, findings = [], 0, 0
    with ThreadPoolExecutor(os.cpu_count()) as workers:  # each target runs in a process of its own
        parts = {
            name: workers.submit(progress.part, name, partial(fuzz, target, SECONDS))
            for name, target in TARGETS.items()
        }
        done = {name: part.result() for name, part in parts.items()}
    for target in TARGETS.values():
        found = msgspec.convert(done[target.name], Fuzzed)
        progress.report(f"{target.name}: {found.executions} executions, {len(found.findings)} findings")
        executions, findings = executions + found.executions, findings + len(found.findings)
        kept = len(list((FOUND / target.name).glob("*")))
        value = f"{found.executions:,} executions, {found.edges:,} branches reached, {len(found.findings)} findings"
        value += f"; {kept} of earlier runs are tests" if kept else ""
        rows.append(Figure(f"`{target.name}`: {target.claim}", value, "0 findings", not found.findings))
    return [
        Figure("targets", str(len(TARGETS)), f"≥ {AT_LEAST}", len(TARGETS) >= AT_LEAST),
        Figure("executions", f"{executions:,}"),
        Figure("findings", str(findings), "0", not findings),
        *rows,
    ]


BARS = (
    Bar(
        "fuzz",
        "Every parser reads any bytes, or refuses them with a declared error",
        "Atheris searches every parser that receives bytes or files of others, guided by the branches of its code, "
        f"for {SECONDS} s. An input breaks a promise if it raises an undeclared error, if a finding has no place, or "
        "if it takes more than 2 s of processor time or 200 MB. Findings are fixed, and their inputs become tests.",
        judge,
        seeds="the corpora in tests/fuzz/corpus and what earlier runs have grown",
    ),
)
