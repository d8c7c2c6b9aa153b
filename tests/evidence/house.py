"""How large the source tree is, what its names and its walks cost, and that flights are what they were, before and after."""

import json
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

GLOC3: Final = str(Path(sys.executable).with_name("gloc3"))
BEFORE: Final = "eb214b0"
"""The commit before the rooms."""
SEED: Final = 1
SAME_M: Final = 0.001
PATH_ERRORS_M: Final = {
    ("patrol", "pelican_rtk"): (0.0345, 0.1967),
    ("inspection", "pelican_rtk"): (0.0396, 0.1771),
    ("inspection", "pelican"): (0.0377, 0.176),
    ("survey", "boat"): (0.744, 1.8545),
    ("survey", "auv"): (2.0754, 3.2782),
}
"""RMS and largest path error of the flights at `BEFORE`, by mission and platform."""


def sizes(root: Path) -> dict[str, Any]:
    """What is measured of a tree."""
    found = measure(root)
    return {
        "files": found.files,
        "lines": found.lines,
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
FEWER: Final = ("files", "lines")


def sizes_before() -> dict[str, Any]:
    """What is measured of the tree at `BEFORE`."""
    archive = subprocess.run(["git", "archive", BEFORE], cwd=ROOT, check=True, capture_output=True).stdout
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=BytesIO(archive)) as tar:
            tar.extractall(folder, filter="data")
        return sizes(Path(folder))


def files_of(walk: str) -> int:
    """How many files a walk passes today."""
    return len(files_on(functions_on(stacks_of(walk))))


def path_errors_m(mission: str, platform: str) -> list[float]:
    """RMS and largest path error of a flight."""
    command = [GLOC3, "fly", mission, "--platform", platform, "--seed", str(SEED), "--json"]
    report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return [report["path_rms_error_m"], report["path_max_error_m"]]


def house(progress: Progress) -> Sequence[Figure]:
    """Sizes, walks and flights."""
    before, after = progress.part("before", sizes_before), progress.part("after", lambda: sizes(ROOT))
    figures = []
    for name, value in after.items():
        most = before[name] - 1 if name in FEWER else MOST.get(name)
        bar = "" if most is None else "fewer" if name in FEWER else f"<= {most}"
        figures.append(Figure(name, f"{before[name]} → {value}", bar, most is None or value <= most))
    for name, walk in WALKS.items():
        count = progress.part(f"walk {name}", partial(files_of, name))
        bar = "" if walk.most_files is None else f"<= {walk.most_files}"
        figures.append(Figure(f"files of the walk {walk.title}", str(count), bar, not bar or count <= walk.most_files))
    for (mission, platform), were_m in PATH_ERRORS_M.items():
        flown = progress.part(f"{mission} {platform}", partial(path_errors_m, mission, platform))
        for kind, was_m, is_m in zip(("RMS", "max"), were_m, flown, strict=True):
            is_same = abs(is_m - was_m) <= SAME_M + 1e-9
            value = f"{was_m:.4f} → {is_m:.4f}"
            figures.append(Figure(f"{mission} on {platform}, path error {kind}, m", value, "equal to 1 mm", is_same))
    return figures


BARS = (
    Bar(
        "house",
        "The source tree before and after it got rooms",
        f"Fewer files and lines than at `{BEFORE}`, small folders, one meaning a name, no import circles, short constructors; "
        "who follows a message through the code opens few files (`docs/walks.md`); and the same flights have the same path "
        "errors to 1 mm.",
        house,
        seeds=str(SEED),
    ),
)
