"""The terminal knows no MAVLink, nothing else knows Textual, and no time is read but the loop's."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import gloc3_groundstation

pytestmark = pytest.mark.thorough

ROOT = Path(gloc3_groundstation.__file__).parent


def imports(folder: Path, pattern: str) -> Iterator[tuple[str, str]]:
    for file in sorted(folder.glob(pattern)):
        for node in ast.walk(ast.parse(file.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            yield from ((file.name, name) for name in names)


def test_nothing_under_tui_knows_mavlink() -> None:
    forbidden = ("gloc3.mavlink", "gloc3.exchange", "gloc3_groundstation.links.links", "pymavlink", "mavsdk")
    assert [(file, name) for file, name in imports(ROOT / "tui", "**/*.py") if name.startswith(forbidden)] == []


def test_nothing_outside_tui_knows_textual() -> None:
    assert [(file, name) for file, name in imports(ROOT, "*.py") if name.split(".")[0] in ("textual", "rich")] == []


def test_the_views_know_no_textual_either() -> None:
    tui = ROOT / "tui"
    pure = [
        *imports(tui / "views", "**/*.py"),
        *(found for file in ("lines", "tables", "view") for found in imports(tui, f"{file}.py")),
    ]
    assert len(pure) > 20
    assert [(file, name) for file, name in pure if name.split(".")[0] in ("textual", "rich")] == []


def test_no_module_reads_the_clock_or_sleeps() -> None:
    clocks = [(file, name) for file, name in imports(ROOT, "**/*.py") if name in ("time", "datetime")]
    assert set(clocks) <= {("certificate.py", "datetime")}, "whose validity is a date; it is given the time"
    assert [file.name for file in ROOT.glob("**/*.py") if "sleep(" in file.read_text()] == []


def test_the_headless_station_loads_no_textual() -> None:
    program = (
        "import sys, gloc3_groundstation.cli.station, gloc3_groundstation.cli.session; print('textual' in sys.modules)"
    )
    path = [str(ROOT.parent), str(ROOT.parents[1] / "common")]
    run = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:0] = {path!r}\n{program}"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.strip() == "False"
