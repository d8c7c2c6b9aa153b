"""Small mistakes planted in the stack, which `gloc3 prove` has to find: one at a time, in a copy of the tree."""

import os
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
MINUTES: Final = 10.0
AT_LEAST: Final = 30
TO_FIND: Final = 27
SHRINKS_S: Final = 1800.0


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
        except (NotFound, SyntaxError) as error:
            found.append(f"{planted.mistake}: {error}")
    return found


def look_for(tree: Path, planted: PlantedMistake, minutes: float = MINUTES) -> dict[str, Any]:
    """Searches a copy of the tree in which the mistake is made; what was found, and when."""
    file = tree / place(planted.mutant)
    right = file.read_text(encoding="utf-8")
    file.write_text(right.replace(planted.old, planted.new), encoding="utf-8")
    out = tree / "runs" / "planted" / f"{crc32(planted.mistake.encode()):08x}"
    called = [sys.executable, "-m", "gloc3", "prove", planted.mission, "--platform", planted.platform]
    called += ["--autopilot", planted.autopilot] if planted.autopilot else []
    called += ["--minutes", f"{minutes:g}", "--first", "--json", "--quiet", "--out", str(out)]
    path = os.pathsep.join(str(tree / folder) for folder in SOURCES)
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        ended = subprocess.run(
            called,
            cwd=tree,
            env=environment,
            check=False,
            capture_output=True,
            text=True,
            timeout=60.0 * minutes + SHRINKS_S,
        )
    finally:
        file.write_text(right, encoding="utf-8")
    try:
        found = msgspec.json.decode(ended.stdout)
    except msgspec.DecodeError:
        return {"is_found": False, "text": ended.stderr.strip()[-200:], "flights": 0}
    smallest = next((one for one in found["found"] if _holds_without_it(tree, environment, one["folder"])), None)
    return {
        "is_found": smallest is not None,
        "flights": found["flights"],
        "search_s": found.get("search_s", 0.0),
        "invariant": smallest["broken"]["invariant"] if smallest else "",
        "faults": len(smallest["case"].get("faults", [])) if smallest else 0,
        "command": smallest["command"] if smallest else "",
    }


def _holds_without_it(tree: Path, environment: dict[str, str], folder: str) -> bool:
    """Whether a finding is the mistake's: the same flight breaks nothing where it is not made."""
    called = [sys.executable, "-m", "gloc3", "prove", "--replay", str(Path(folder, "replay.json")), "--quiet"]
    return subprocess.run(called, cwd=tree, env=environment, check=False, capture_output=True).returncode == 0


def judge(progress: Progress) -> Sequence[Figure]:
    """The figures."""
    if wrong := problems():
        return [Figure("mistakes whose place is not found", "; ".join(wrong), "none", False)]
    rows, found = [], []
    with copied() as tree:
        for planted in mistakes():
            key = f"{planted.old}>{planted.new}"
            result = progress.part(key, partial(look_for, tree, planted))
            progress.report(f"{planted.mistake}: {result.get('invariant') or 'not found'}")
            found += [result] if result["is_found"] else []
            value = (
                f"`{result['invariant']}` after {result['flights']} flights ({result['search_s']:.0f} s), "
                f"{result['faults']} faults left: `{result['command']}`"
                if result["is_found"]
                else f"not found in {result['flights']} flights"
            )
            rows.append(Figure(planted.mistake, value))
    seconds = [one["search_s"] for one in found]
    return [
        Figure("mistakes", str(len(rows)), f"≥ {AT_LEAST}", len(rows) >= AT_LEAST),
        Figure(f"found within {MINUTES:g} minutes each", str(len(found)), f"≥ {TO_FIND}", len(found) >= TO_FIND),
        Figure("median time to find, in s", f"{median(seconds):.0f}" if seconds else "none"),
        *rows,
    ]


BARS = (
    Bar(
        "planted",
        "Planted mistakes that the search finds",
        "Each of these mistakes is made alone in a copy of the tree. `gloc3 prove` does not know of it, and finds a flight that "
        f"it breaks, within {MINUTES:g} minutes on this machine.",
        judge,
        seeds="0",
    ),
)
