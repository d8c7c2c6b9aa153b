"""The commands that the README, the docs and the evidence pages quote exist, with the options that are quoted."""

import re
import shlex
from functools import cache
from importlib.metadata import entry_points
from itertools import product
from pathlib import Path

import pytest
from tests.evidence.__main__ import BARS

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[2]
MADE_FROM_HELP = ROOT / "docs/reference/commands.md"
PAGES = [*sorted(ROOT.glob("*.md")), *(one for one in sorted((ROOT / "docs").rglob("*.md")) if one != MADE_FROM_HELP)]
COMMAND = re.compile(r"`(gloc3 [^`]+)`|^(?:\$ )?(gloc3 .+)$", re.MULTILINE)
EVIDENCE = {bar.name for bar in BARS}
FUZZED = {path.name for path in (ROOT / "tests/fuzz/corpus").iterdir()}
MAKE = re.compile(r"(?:`|^)make ([a-z]+)(?: NAME=([\w-]+))?", re.MULTILINE)


def quoted(page: Path) -> list[str]:
    """The commands of a page, each of several words such as `info|plot` written out."""
    lines = [(inline or line).partition("#")[0] for inline, line in COMMAND.findall(page.read_text())]
    return [" ".join(words) for line in lines for words in product(*(word.split("|") for word in shlex.split(line)))]


@cache
def known(name: str) -> object:
    """A subcommand's application."""
    return next(point for point in entry_points(group="gloc3.commands") if point.name == name).load()


def what_is_wrong_with(command: str) -> str:
    """The first word of a command that means nothing; empty where there is none."""
    name, *words = command.split()[1:]
    if name not in {point.name for point in entry_points(group="gloc3.commands")}:
        return "" if re.fullmatch(r"[A-Z]+|--help|--version", name) else name
    app = known(name)
    while words and words[0][0] != "-" and words[0] in app:  # type: ignore[operator] # cyclopts finds subcommands so
        app = app[words.pop(0)]  # type: ignore[index]
    if app.default_command is None:  # type: ignore[attr-defined]
        return words[0] if words and words[0].islower() else ""
    options = {one for argument in app.assemble_argument_collection() for one in argument.names}  # type: ignore[attr-defined]
    given = (word.partition("=")[0] for word in words)
    return next((word for word in given if word.startswith("--") and word not in {*options, "--help"}), "")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_and_options_that_are_quoted_exist(page: Path) -> None:
    assert [(command, wrong) for command in quoted(page) if (wrong := what_is_wrong_with(command))] == []


def test_a_command_or_an_option_that_is_gone_would_be_found() -> None:
    assert what_is_wrong_with("gloc3 sitl --sensors 1 --camera 2") == "--camera"
    assert what_is_wrong_with("gloc3 log inform") == "inform"
    assert what_is_wrong_with("gloc3 flight hop") == "flight"
    assert sum(len(quoted(page)) for page in PAGES) > 50


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_is_to_be_made_can_be_made(page: Path) -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for target, name in MAKE.findall(page.read_text()):
        assert target in targets, target
        known = FUZZED if target == "fuzz" else EVIDENCE
        assert not name or name in known, name
