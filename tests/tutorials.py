"""Does the tutorials of `docs/tutorials` to the letter, in the environment of a reader.

A block of `console` holds commands, each with the lines that it prints; `…` stands for what may differ, and alone on a
line for any number of lines. Blocks of `sh` are run; those of `bash` are for a reader at a terminal of their own.
"""

import re
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final, NamedTuple

PAGES: Final = Path(__file__).parents[1] / "docs" / "tutorials"
STEP: Final = re.compile(
    r"^(?:`(?P<file>[\w./-]+)`:\n\n)?```(?P<kind>\w+)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)
WRONG_USE: Final = 2


class Reader(NamedTuple):
    """Somebody who does a tutorial."""

    folder: Path
    environment: Mapping[str, str]


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


def do(page: str, reader: Reader) -> None:
    """Does what a page says; what it starts beside ends with it.

    Raises:
        AssertionError: a command failed, or printed something else.
    """
    found = 0
    with ExitStack() as stack:
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
