"""Does the tutorials to the letter, each in a fresh environment: their files, their commands, and the lines that they show.

A block of `console` holds commands, each with the lines that it prints; `…` stands for what may differ, and alone on a
line for any number of lines. Blocks of `sh` are run; those of `bash` are for a reader at a terminal of their own.
"""

import os
import re
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.commands.foxglove_layout import check_layout
from tests.commands.fresh import fresh_environment, unpacked_wheel

pytestmark = [pytest.mark.flight, pytest.mark.sockets]

PAGES = Path(__file__).parents[2] / "docs" / "tutorials"
STEP = re.compile(r"^(?:`(?P<file>[\w./-]+)`:\n\n)?```(?P<kind>\w+)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
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


class Reader(NamedTuple):
    """Somebody who does a tutorial."""

    folder: Path
    environment: Mapping[str, str]


@pytest.fixture
def reader(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Reader:
    """One in an empty folder, with GLOC3 from its wheel and an environment of their own."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base
    site = unpacked_wheel(shared)
    environment = fresh_environment(tmp_path / "venv", site)
    folder = tmp_path / "home"
    folder.mkdir()
    found = Reader(folder, {**environment, "XDG_CONFIG_HOME": str(folder), "COLUMNS": "120"})
    assert run("python -c 'import gloc3; print(gloc3.__file__)'", found).startswith(str(site))
    return found


@contextmanager
def beside(command: str, reader: Reader) -> Iterator[None]:
    """Runs a program in the background."""
    program = command.strip().removesuffix("&")
    process = subprocess.Popen(
        ["bash", "-c", f"exec {program}"], cwd=reader.folder, env=reader.environment, start_new_session=True
    )
    try:
        yield
    finally:
        process.terminate()
        process.wait(20.0)


def run(command: str, reader: Reader) -> str:
    """What a command prints, warnings and errors too."""
    done = subprocess.run(
        ["bash", "-c", command],
        cwd=reader.folder,
        env=reader.environment,
        check=False,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300.0,
    )
    assert done.returncode < WRONG_USE, f"{command}\n{done.stdout}"
    return done.stdout


@pytest.mark.parametrize("page", sorted(path.stem for path in PAGES.glob("*.md")))
def test_a_tutorial_is_done_to_the_letter(page: str, reader: Reader) -> None:
    with ExitStack() as stack:
        do(page, reader, stack)
    if page == "foxglove":
        shown = check_layout(reader.folder / "filmed")
        assert set(shown) == {"ThreeDee", "Image", "Plot", "Log", "Map"}
        named = set(re.findall(r"`((?:frames|scene|filmed|calibration)[\w/]*)`", panels_of(page)))
        assert named == {"frames"}.union(*shown.values())


def panels_of(page: str) -> str:
    """The table of panels of a page, without those that are mentioned only."""
    (table,) = re.findall(
        r"^\| panel .*?\n\n", (PAGES / f"{page}.md").read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    return str(table)


def do(page: str, reader: Reader, stack: ExitStack) -> None:
    """Does what a page says; what it starts beside ends with the stack."""
    found = 0
    for step in STEP.finditer((PAGES / f"{page}.md").read_text(encoding="utf-8")):
        kind, text, file = step["kind"], step["text"], step["file"]
        if file:
            (reader.folder / file).parent.mkdir(parents=True, exist_ok=True)
            (reader.folder / file).write_text(text, encoding="utf-8")
        elif kind == "sh" and text.rstrip().endswith("&"):
            stack.enter_context(beside(text, reader))
        elif kind == "sh":
            run(text, reader)
        elif kind == "console":
            for command, lines in commands(text):
                output = run(command, reader)
                assert pattern(lines).fullmatch(output), f"{command}\n{output}"
                found += 1
    assert found
