"""Small mistakes planted in the stack, which `gloc3 prove` has to find: one at a time, in a copy of the tree."""

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, Final
from zlib import crc32

import msgspec
from tests.evidence.mutants import SOURCES, Mutant, NotFound, copied, place, texts
from tests.evidence.page import ROOT, Bar, Figure, Progress

LIST: Final = ROOT / "tests/proof/planted/mistakes.yaml"
FLIGHTS: Final = 1600
BUDGET_S: Final = 1200.0
"""Ten minutes on two cores, in seconds of one processor: so the load of the machine does not count."""
SHRINK: Final = 40
AT_LEAST: Final = 30
TO_FIND: Final = 27
MARKS: Final = "not sockets and not outside and not firmware"
FLOWN: Final = (
    "tests/flight/test_restart_in_flight.py",
    "tests/flight/test_supervision.py",
    "tests/flight/test_the_human_pilot_wins.py",
)
"""Flights with every mistake: what they notice, too, is counted."""


class PlantedMistake(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A mistake, and the flights in which it is looked for."""

    mistake: str
    old: str
    new: str
    breaks: str
    """The invariant that it is expected to break."""
    within: str = ""
    mission: str = "hop"
    platform: str = "pelican_rtk"
    autopilot: str = ""

    @property
    def mutant(self) -> Mutant:
        """The mistake as the page `mutants` has it."""
        return Mutant(promise="", mistake=self.mistake, old=self.old, new=self.new, test="", within=self.within)


def mistakes() -> list[PlantedMistake]:
    """All of them."""
    return msgspec.yaml.decode(LIST.read_bytes(), type=list[PlantedMistake])


def problems() -> list[str]:
    """What is wrong with the list itself."""
    found = []
    for planted in mistakes():
        try:
            changed = texts(*SOURCES)[place(planted.mutant)].replace(planted.old, planted.new)
            compile(changed, planted.mistake, "exec")
            if not touching(planted):
                found.append(f"{planted.mistake}: no test touches it")
        except (NotFound, SyntaxError) as error:
            found.append(f"{planted.mistake}: {error}")
    return found


def touching(planted: PlantedMistake) -> list[str]:
    """The tests that touch the module with the mistake.

    They are the folder of tests that mirrors its room, and the test files elsewhere that import it.
    """
    file = place(planted.mutant)
    module = ".".join(file.with_suffix("").parts[1:])
    room, _, name = module.rpartition(".")
    imports = re.compile(
        rf"^(from {re.escape(module)} import|import {re.escape(module)}\b|from {re.escape(room)} import .*\b{name}\b)",
        re.MULTILINE,
    )
    mirror = Path("tests", file.parts[0], *file.parts[2:-1])
    while not (ROOT / mirror).is_dir():
        mirror = mirror.parent
    files = {
        str(path) for path, text in texts("tests").items() if path.name.startswith("test_") and imports.search(text)
    }
    elsewhere = sorted(path for path in files if not path.startswith(f"{mirror}/"))
    return [str(mirror), *elsewhere]


def _environment(tree: Path) -> dict[str, str]:
    path = os.pathsep.join(str(tree / folder) for folder in SOURCES)
    return {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}


class _Made:
    """A copy of the tree in which a mistake is made, as a context."""

    def __init__(self, tree: Path, planted: PlantedMistake) -> None:
        self._file = tree / place(planted.mutant)
        self._planted, self._right = planted, self._file.read_text(encoding="utf-8")

    def __enter__(self) -> None:
        self._file.write_text(self._right.replace(self._planted.old, self._planted.new), encoding="utf-8")

    def __exit__(self, *_: object) -> None:
        self._file.write_text(self._right, encoding="utf-8")


def survival(tree: Path, planted: PlantedMistake, tests: Sequence[str]) -> dict[str, Any]:
    """Whether tests pass with the mistake, and which do not."""
    called = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "auto", "-p", "no:cacheprovider", "-m", MARKS, *tests]
    with _Made(tree, planted):
        ended = subprocess.run(called, cwd=tree, env=_environment(tree), check=False, capture_output=True, text=True)
    lines = ended.stdout.strip().splitlines() or [ended.stderr.strip()[-200:]]
    killed = next((line for line in lines if line.startswith(("FAILED", "ERROR"))), "")
    return {"is_survivor": ended.returncode == 0, "killed": killed, "summary": lines[-1]}


def look_for(tree: Path, planted: PlantedMistake) -> dict[str, Any]:
    """Searches a copy of the tree in which the mistake is made; what was found, and at which cost."""
    out = tree / "runs" / "planted" / f"{crc32(planted.mistake.encode()):08x}"
    called = [sys.executable, "-m", "gloc3", "prove", planted.mission, "--platform", planted.platform]
    called += ["--autopilot", planted.autopilot] if planted.autopilot else []
    called += ["--flights", str(FLIGHTS), "--shrink", str(SHRINK), "--first", "--json", "--quiet", "--out", str(out)]
    with _Made(tree, planted):
        ended = subprocess.run(called, cwd=tree, env=_environment(tree), check=False, capture_output=True, text=True)
    try:
        found = msgspec.json.decode(ended.stdout)
    except msgspec.DecodeError:
        return {"is_found": False, "text": ended.stderr.strip()[-200:], "flights": 0, "processor_s": 0.0}
    smallest = next((one for one in found["found"] if _holds_without_it(tree, one)), None)
    return {
        "is_found": smallest is not None and found["processor_s"] <= BUDGET_S,
        "flights": found["flights"],
        "processor_s": found["processor_s"],
        "invariant": smallest["broken"]["invariant"] if smallest else "",
        "faults": len(smallest["case"].get("faults", [])) if smallest else 0,
        "command": smallest["command"].replace(f"{smallest['folder']}/", "") if smallest else "",
        "line": msgspec.json.encode(smallest["case"]).decode() if smallest else "",
    }


def _holds_without_it(tree: Path, finding: dict[str, Any]) -> bool:
    """Whether a finding is the mistake's: in the same flight the invariant holds where it is not made.

    Another one may not: of a mission the landing may have been left out.
    """
    called = [sys.executable, "-m", "gloc3", "prove", "--json", "--replay", str(Path(finding["folder"], "replay.json"))]
    ended = subprocess.run(called, cwd=tree, env=_environment(tree), check=False, capture_output=True, text=True)
    broken = msgspec.json.decode(ended.stdout).get("broken", [])
    return finding["broken"]["invariant"] not in [one["invariant"] for one in broken]


def judge(progress: Progress) -> Sequence[Figure]:
    """The figures."""
    if wrong := problems():
        return [Figure("mistakes whose place is not found", "; ".join(wrong), "none", False)]
    rows, found, killed, noticed = [], [], 0, 0
    with copied() as tree:
        for planted in mistakes():
            key = f"{planted.old}>{planted.new}"
            tested = progress.part(f"tests {key}", partial(survival, tree, planted, touching(planted)))
            flown = progress.part(f"flights {key}", partial(survival, tree, planted, FLOWN))
            result = progress.part(f"search {key}", partial(look_for, tree, planted))
            progress.report(f"{planted.mistake}: {result.get('invariant') or 'not found'}; {tested['summary']}")
            killed += not tested["is_survivor"]
            noticed += not flown["is_survivor"]
            found += [result] if result["is_found"] else []
            rows.append(Figure(planted.mistake, _found(result)))
            rows.append(_tested(planted, tested))
            rows.append(Figure("… in three files of flights", flown["killed"] or flown["summary"]))
    costs, flights = [one["processor_s"] for one in found], [one["flights"] for one in found]
    return [
        Figure("mistakes", str(len(mistakes())), f"≥ {AT_LEAST}", len(mistakes()) >= AT_LEAST),
        Figure("which a test that touches them notices", str(killed), "0", not killed),
        Figure("which one of three files of flights notices, too", str(noticed)),
        Figure(
            f"found in {FLIGHTS} flights and {BUDGET_S:.0f} s of one processor each",
            str(len(found)),
            f"≥ {TO_FIND}",
            len(found) >= TO_FIND,
        ),
        Figure("median flights to find one", f"{median(flights):.0f}" if flights else "none"),
        Figure("median seconds of one processor", f"{median(costs):.0f}" if costs else "none"),
        *rows,
    ]


def _found(result: dict[str, Any]) -> str:
    if not result["is_found"]:
        return f"not found in {result['flights']} flights ({result['processor_s']:.0f} s)"
    return (
        f"`{result['invariant']}` after {result['flights']} flights ({result['processor_s']:.0f} s), "
        f"{result['faults']} faults left: `{result['command']}`"
    )


def _tested(planted: PlantedMistake, tested: dict[str, Any]) -> Figure:
    ran = ", ".join(touching(planted))
    is_survivor = tested["is_survivor"]
    return Figure("… with it", f"{ran}: {tested['killed'] or tested['summary']}", "pass", is_survivor)


BARS = (
    Bar(
        "planted",
        "The search finds planted mistakes that the tests miss",
        "Each of these mistakes is made alone in a copy of the tree. The tests that touch the module still pass: the "
        f"folder of tests for its room, and the files that import it (`pytest -m '{MARKS}'`). Three files of flights are "
        "run with it as well. What they notice needs no search; it shows how soon the search finds what a flight breaks. "
        "`gloc3 prove` does not know the mistake, and finds a flight that it breaks and that breaks nothing without "
        "it. The time is the processor's, so that other work on the machine does not count: ten minutes on two cores "
        "are 1,200 s.",
        judge,
        seeds="0",
    ),
)
