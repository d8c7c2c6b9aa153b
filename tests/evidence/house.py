"""How large the source tree is, what its names and its walks cost, and that flights are what they were, before and after."""

import json
import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, Final

from tests.evidence.page import ROOT, Bar, Figure, Progress
from tests.house.measure import measure
from tests.house.walks import WALKS, files_on, functions_on, stacks_of

BEFORE: Final = "eb214b0"
"""The commit before the rooms."""
AFTER: Final = "c17d1752"
"""The last commit of the step that made the rooms. Later ones add features and fly some corners closer."""
SEED: Final = 1
SAME_M: Final = 0.001
FLIGHTS: Final = (
    ("patrol", "pelican_rtk"),
    ("inspection", "pelican_rtk"),
    ("inspection", "pelican"),
    ("survey", "boat"),
    ("survey", "auv"),
)
"""Missions and platforms."""


def sizes(root: Path) -> dict[str, Any]:
    """What is measured of a tree."""
    found = measure(root)
    return {
        "files": found.files,
        "lines": found.lines,
        "statements": found.statements,
        "test files": found.test_files,
        "test lines": found.test_lines,
        "modules in the largest folder": found.largest_folder[1],
        "public class names that are used more than once": len(found.reused_class_names),
        "of these within one package": len(found.reused_in_a_package),
        "import circles": len(found.circles),
        "lines of the longest constructor": found.longest_constructor[1],
        "functions with more than 7 parameters": len(found.many_parameters),
    }


MOST: Final = {
    "modules in the largest folder": 20,
    "public class names that are used more than once": 15,
    "of these within one package": 0,
    "import circles": 0,
    "lines of the longest constructor": 40,
    "functions with more than 7 parameters": 10,
}
FEWER: Final = ("files", "lines", "statements")
"""What the step was to make fewer."""


def unpack(commit: str, folder: Path) -> None:
    """Puts the tree of a commit into a folder."""
    archive = subprocess.run(["git", "archive", commit], cwd=ROOT, check=True, capture_output=True).stdout
    with tarfile.open(fileobj=BytesIO(archive)) as tar:
        tar.extractall(folder, filter="data")


def sizes_at(commit: str) -> dict[str, Any]:
    """What is measured of the tree at a commit."""
    with tempfile.TemporaryDirectory() as folder:
        unpack(commit, Path(folder))
        return sizes(Path(folder))


def files_of(walk: str) -> int:
    """How many files a walk passes today."""
    return len(files_on(functions_on(stacks_of(walk))))


def path_errors_m(mission: str, platform: str, packages: Path | None = None) -> list[float]:
    """RMS and largest path error of a flight.

    Args:
        mission: its name.
        platform: its name.
        packages: folder with the packages of another commit; None for those of this tree.
    """
    program = [sys.executable, "-P", "-m", "gloc3", "fly"]
    command = [*program, mission, "--platform", platform, "--seed", str(SEED), "--json"]
    environment = os.environ | ({} if packages is None else {"PYTHONPATH": str(packages)})
    with tempfile.TemporaryDirectory() as folder:
        flown = subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True, text=True)
    report = json.loads(flown.stdout)
    return [report["path_rms_error_m"], report["path_max_error_m"]]


def path_errors_at_m(commit: str) -> list[list[float]]:
    """RMS and largest path errors of all flights, with the packages of a commit and the libraries of this tree."""
    with tempfile.TemporaryDirectory() as folder:
        tree, packages = Path(folder, "tree"), Path(folder, "packages")
        tree.mkdir()
        unpack(commit, tree)
        install = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps"]
        subprocess.run([*install, "--no-build-isolation", "--target", str(packages), str(tree)], check=True)
        return [path_errors_m(*flight, packages) for flight in FLIGHTS]


def house(progress: Progress) -> Sequence[Figure]:
    """Sizes, walks and flights."""
    before, after = progress.part("before", partial(sizes_at, BEFORE)), progress.part("after", partial(sizes_at, AFTER))
    figures = []
    for name, today in progress.part("today", partial(sizes, ROOT)).items():
        value = f"{before[name]} → {after[name]}, today {today}"
        if name in FEWER:
            figures.append(Figure(name, value, "fewer after the step", after[name] < before[name]))
        elif name in MOST:
            is_met = max(after[name], today) <= MOST[name]
            figures.append(Figure(name, value, f"<= {MOST[name]}, today, too", is_met))
        else:
            figures.append(Figure(name, value))
    for name, walk in WALKS.items():
        count = progress.part(f"walk {name}", partial(files_of, name))
        bar = "" if walk.most_files is None else f"<= {walk.most_files}"
        figures.append(Figure(f"files of the walk {walk.title}", str(count), bar, not bar or count <= walk.most_files))
    flown_m = [progress.part(f"flights at {commit}", partial(path_errors_at_m, commit)) for commit in (BEFORE, AFTER)]
    for flight, were_m, became_m in zip(FLIGHTS, *flown_m, strict=True):
        are_m = progress.part(f"flight {flight} today", partial(path_errors_m, *flight))
        for kind, was_m, became, is_m in zip(("RMS", "max"), were_m, became_m, are_m, strict=True):
            title = f"{' on '.join(flight)}, path error {kind}, m"
            is_same = abs(became - was_m) <= SAME_M + 1e-9
            figures.append(Figure(title, f"{was_m:.4f} → {became:.4f}", "equal to 1 mm", is_same))
            figures.append(Figure("… today", f"{is_m:.4f}", "no larger, to 1 mm", is_m <= became + SAME_M + 1e-9))
    return figures


BARS = (
    Bar(
        "house",
        "The source tree got small folders, short constructors and no import circles",
        f"One step gave the tree its rooms: it begins after `{BEFORE}` and ends with `{AFTER}`. It leaves fewer files "
        "and less code, small folders, one meaning for a name, no import circles and short constructors. Few files "
        "have to be opened to follow a message through the code (`docs/walks.md`, today's), and the same flights have "
        "the same path errors to 1 mm. Figures with an arrow compare these two commits, each flown with its own "
        "packages on this machine. Of the lines that the step added, six in seven are docstrings, comments and blank "
        "lines. Lines and statements have grown since with features (the proof search, habits of real firmware, "
        "fences on the autopilot, fixed wings), and multirotors now fly closer corners on purpose.",
        house,
        seeds=str(SEED),
    ),
)
