"""Does the tutorials to the letter: writes their files, runs their commands, and compares the lines that they show.

A block of `console` holds commands, each with the lines that it prints; `…` stands for what may differ, and alone on a
line for any number of lines. Blocks of `sh` are run; those of `bash` are for a reader at a terminal of their own.
"""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from tests.commands.foxglove_layout import check_layout
from tests.package_of_page import install

pytestmark = [pytest.mark.flight, pytest.mark.sockets]

PAGES = Path(__file__).parents[2] / "docs" / "tutorials"
STEP = re.compile(r"^(?:`(?P<file>[\w./-]+)`:\n\n)?```(?P<kind>\w+)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
INSTALL = "pip install --editable ."
WRONG_USE = 2


def commands(text: str) -> Iterator[tuple[str, list[str]]]:
    """The commands of a block of `console`, each with the lines that it prints."""
    for one in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        command, *lines = one.rstrip("\n").split("\n")
        yield command, lines


def pattern(lines: list[str]) -> re.Pattern[str]:
    """What the output has to match."""
    return re.compile(
        "".join(r"(?:.*\n)*" if line == "…" else re.escape(line).replace("…", ".*") + r"\s*\n" for line in lines)
    )


def surroundings(folder: Path) -> dict[str, str]:
    """The environment of a command: this `gloc3` on the path, and the packages of the page."""
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return os.environ | {"PATH": programs, "PYTHONPATH": str(folder), "XDG_CONFIG_HOME": str(folder), "COLUMNS": "120"}


@contextmanager
def beside(command: str, folder: Path) -> Iterator[None]:
    """Runs a program in the background."""
    program = command.strip().removesuffix("&")
    process = subprocess.Popen(
        ["bash", "-c", f"exec {program}"], cwd=folder, env=surroundings(folder), start_new_session=True
    )
    try:
        yield
    finally:
        process.terminate()
        process.wait(20.0)


def run(command: str, folder: Path) -> str:
    """What a command prints, warnings and errors too."""
    done = subprocess.run(
        ["bash", "-c", command],
        cwd=folder,
        env=surroundings(folder),
        check=False,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300.0,
    )
    assert done.returncode < WRONG_USE, f"{command}\n{done.stdout}"
    return done.stdout


@pytest.mark.parametrize("page", sorted(path.stem for path in PAGES.glob("*.md")))
def test_a_tutorial_is_done_to_the_letter(page: str, tmp_path: Path) -> None:
    with ExitStack() as stack:
        do(page, tmp_path, stack)
    if page == "foxglove":
        shown = check_layout(tmp_path / "filmed")
        assert set(shown) == {"ThreeDee", "Image", "Plot", "Log", "Map"}
        named = set(re.findall(r"`((?:frames|scene|filmed|calibration)[\w/]*)`", panels_of(page)))
        assert named == {"frames"}.union(*shown.values())


def panels_of(page: str) -> str:
    """The table of panels of a page, without those that are mentioned only."""
    (table,) = re.findall(
        r"^\| panel .*?\n\n", (PAGES / f"{page}.md").read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    return str(table)


def do(page: str, tmp_path: Path, stack: ExitStack) -> None:
    """Does what a page says; what it starts beside ends with the stack."""
    found = 0
    for step in STEP.finditer((PAGES / f"{page}.md").read_text(encoding="utf-8")):
        kind, text, file = step["kind"], step["text"], step["file"]
        if file:
            (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / file).write_text(text, encoding="utf-8")
        elif kind == "sh" and text.strip() == INSTALL:
            install((tmp_path / "pyproject.toml").read_text(encoding="utf-8"), tmp_path)
        elif kind == "sh" and text.rstrip().endswith("&"):
            stack.enter_context(beside(text, tmp_path))
        elif kind == "sh":
            run(text, tmp_path)
        elif kind == "console":
            for command, lines in commands(text):
                output = run(command, tmp_path)
                assert pattern(lines).fullmatch(output), f"{command}\n{output}"
                found += 1
    assert found
