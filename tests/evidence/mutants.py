"""Small mistakes in the sources, each of which must make the test of the promise that it breaks fail.

They are made in a copy of the tree. Each is found by a text that stands once in the sources, not by a path.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

import msgspec
from tests.evidence.page import ROOT, Bar, Figure, Progress

SOURCES: Final = ("common", "onboard", "groundstation", "sitl")
LIST: Final = Path(__file__).with_suffix(".yaml")
AT_LEAST: Final = 20
FAILED: Final = 1
"""What pytest ends with where tests ran, and not all of them passed."""


class Mutant(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A mistake, and the test that is to notice it."""

    promise: str
    mistake: str
    old: str
    new: str
    test: str
    """The test's name, without its file."""
    within: str = ""
    """A class or function of the file that is meant, where `old` stands in several."""


class NotFound(Exception):
    """A mutant whose text or test is not there, or more than once."""


def mutants() -> list[Mutant]:
    """All of them."""
    return msgspec.yaml.decode(LIST.read_bytes(), type=list[Mutant])


@cache
def texts(*folders: str) -> dict[Path, str]:
    """The Python files in some folders of the project, below its own."""
    files = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    return {path.relative_to(ROOT): path.read_text(encoding="utf-8") for path in files}


def place(mutant: Mutant) -> Path:
    """The file that the mistake is made in.

    Raises:
        NotFound: its text does not stand there exactly once.
    """
    is_meant = re.compile(rf"\b(class|def) {mutant.within}\b" if mutant.within else "")
    counts = {
        path: text.count(mutant.old)
        for path, text in texts(*SOURCES).items()
        if mutant.old in text and is_meant.search(text)
    }
    if list(counts.values()) != [1]:
        where = ", ".join(f"{path} ({count})" for path, count in counts.items()) or "nowhere"
        raise NotFound(f"{mutant.old!r} must stand once in the sources, and stands {where}")
    return next(iter(counts))


def test_of(mutant: Mutant) -> str:
    """The test, as pytest takes it.

    Raises:
        NotFound: there is none of this name, or more than one.
    """
    defines = re.compile(rf"^(async )?def {mutant.test}\(", re.MULTILINE)
    files = [path for path, text in texts("tests").items() if defines.search(text)]
    if len(files) != 1:
        raise NotFound(f"there must be one {mutant.test}, and there are {len(files)}")
    return f"{files[0].as_posix()}::{mutant.test}"


def problems() -> list[str]:
    """What is wrong with the list itself."""
    found = []
    for mutant in mutants():
        try:
            changed = texts(*SOURCES)[place(mutant)].replace(mutant.old, mutant.new)
            compile(changed, mutant.old, "exec")
            test_of(mutant)
        except (NotFound, SyntaxError) as error:
            found.append(f"{mutant.promise} ({mutant.mistake}): {error}")
    return found


@contextmanager
def copied() -> Iterator[Path]:
    """A copy of the project, as it lies there."""
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    with tempfile.TemporaryDirectory() as folder:
        for name in filter(None, names.split("\0")):
            if (ROOT / name).is_file():
                (target := Path(folder, name)).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / name, target)
        yield Path(folder)


def run_tests(tree: Path, tests: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Runs tests of a copy, with the sources of the copy in all processes that they start."""
    path = os.pathsep.join(str(tree / folder) for folder in SOURCES)
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
    called = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    return subprocess.run(called, cwd=tree, env=environment, check=False, capture_output=True, text=True)


def outcome(tree: Path, mutant: Mutant) -> str:
    """What becomes of the test when the mistake is made: `fails` is as it should be."""
    file = tree / place(mutant)
    right = file.read_text(encoding="utf-8")
    file.write_text(right.replace(mutant.old, mutant.new), encoding="utf-8")
    try:
        ended = run_tests(tree, [test_of(mutant)])
    finally:
        file.write_text(right, encoding="utf-8")
    if ended.returncode == 0:
        return "passes"
    return "fails" if ended.returncode == FAILED else f"does not run: {ended.stdout[-200:]}"


def run_all(progress: Progress) -> dict[str, Any]:
    """The outcomes by mutant, and how the tests go without any mistake."""
    found: dict[str, Any] = {}
    with copied() as tree:
        right = run_tests(tree, sorted({test_of(mutant) for mutant in mutants()}))
        found["right"] = right.stdout.strip().rpartition("\n")[2]
        found["is_right"] = right.returncode == 0
        for mutant in mutants():
            key = f"{mutant.promise}: {mutant.mistake}"
            found[key] = progress.part(f"{mutant.old}>{mutant.new}", partial(outcome, tree, mutant))
            progress.report(f"{key}: {found[key]}")
    return found


def judge(progress: Progress) -> list[Figure]:
    """The figures."""
    if wrong := problems():
        return [Figure("mutants whose place or test is not found", "; ".join(wrong), "none", False)]
    found, all_of_them = run_all(progress), mutants()
    several = Counter(mutant.promise for mutant in all_of_them)
    rows = [
        Figure(
            f"{mutant.promise}: {mutant.mistake}",
            f"`{mutant.test}` {(result := found[f'{mutant.promise}: {mutant.mistake}'])}",
            "fails",
            result == "fails",
        )
        for mutant in all_of_them
    ]
    return [
        Figure("mistakes", str(len(rows)), f"≥ {AT_LEAST}", len(rows) >= AT_LEAST),
        Figure("promises", str(len(several))),
        Figure("their tests without any mistake", found["right"], "all pass", found["is_right"]),
        *rows,
    ]


BARS = (
    Bar(
        "mutants",
        "A small mistake that breaks a promise makes a test fail",
        "Each row makes one small mistake in the code that breaks a promise. The test of that promise fails.",
        judge,
        seeds="as in the tests",
    ),
)
