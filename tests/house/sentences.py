"""Sentences that people read: of the README and the docs, of the commands' help, and of messages."""

import ast
import random
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

from tests.house import troubleshooting
from tests.house.measure import read_modules

ROOT: Final = Path(__file__).parents[2]
MADE: Final = frozenset(["where-things-are.md", "public-api.md", "walks.md", "troubleshooting.md"])
"""Pages that are made from the code; what they quote counts where it stands."""
FEWEST_WORDS: Final = 6
_FENCE: Final = re.compile(r"^( *)(```|~~~).*?^\1\2 *$", re.MULTILINE | re.DOTALL)
_NO_PROSE: Final = re.compile(r"^\s*(?:\||#|!\[|\*`|<)")
_ITEM: Final = re.compile(r"^\s*(?:[-*]|\d+\.) ")
_END: Final = re.compile(r"(?<=[.!?])[)*_]*\s+(?=[\"*_(\[]*[A-Z0-9`])")
_ARGUMENT: Final = re.compile(r"^    \w[\w ]*(?: \(.*?\))?: (.+?)(?=^    \S|^\S|\Z)", re.MULTILINE | re.DOTALL)


class Sentence(NamedTuple):
    """A sentence and its file, relative to the root."""

    where: str
    text: str


def _once(kind: Callable[[], Iterator[Sentence]]) -> Callable[[], tuple[Sentence, ...]]:
    """Finds sentences once a process, because that takes seconds."""
    return cache(lambda: tuple(kind()))


@_once
def of_pages() -> Iterator[Sentence]:
    """Sentences of the README and of the docs that are written by hand, evidence aside."""
    pages = [page for page in (ROOT / "docs").rglob("*.md") if page.parent.name != "evidence" and page.name not in MADE]
    for page in [ROOT / "README.md", *sorted(pages)]:
        for paragraph in _paragraphs(page.read_text(encoding="utf-8")):
            yield from _sentences(page, paragraph)


@_once
def of_help() -> Iterator[Sentence]:
    """Sentences of the docstrings and parameters from which the commands' help is made."""
    for module in read_modules(ROOT).values():
        if "cli" in module.path.with_suffix("").parts:
            for node in module.nodes:
                if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and _is_command(node):
                    text, _, arguments = (ast.get_docstring(node) or "").partition("\nArgs:\n")
                    for part in (*text.split("\n\n"), *_ARGUMENT.findall(arguments)):
                        yield from _sentences(ROOT / module.path, part)


@_once
def of_messages() -> Iterator[Sentence]:
    """Messages of errors, refusals, checks and findings, with their hints; `…` stands for what differs."""
    for module in read_modules(ROOT).values():
        texts = [
            troubleshooting.said(argument)
            for node in module.nodes
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)
            for argument in node.exc.args
        ]
        texts += [part for row in troubleshooting.remedies(module.nodes) for part in row]
        for text in texts:
            yield from _sentences(ROOT / module.path, text)


KINDS: Final[tuple[tuple[Callable[[], tuple[Sentence, ...]], int], ...]] = (
    (of_pages, 36),
    (of_help, 12),
    (of_messages, 12),
)
"""Where sentences are, and how many of each kind a sample has."""


def sample(seed: int) -> list[Sentence]:
    """A sample of all kinds, drawn with a seed."""
    chance = random.Random(seed)
    return [each for kind, count in KINDS for each in chance.sample(sorted(set(kind())), count)]


def _is_command(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Whether it is decorated as `@app.command` or `@app.default`, called or not."""
    words = re.findall(r"\w+", " ".join(map(ast.unparse, function.decorator_list)))
    return not {"command", "default"}.isdisjoint(words)


def _paragraphs(page: str) -> Iterator[str]:
    """Paragraphs and items of lists of a page in Markdown, without tables, code, headings and pictures."""
    for block in _FENCE.sub("", page).split("\n\n"):
        lines: list[str] = []
        for line in block.split("\n"):
            if (_ITEM.match(line) or _NO_PROSE.match(line)) and lines:
                yield "\n".join(lines)
                lines = []
            if not _NO_PROSE.match(line):
                lines.append(_ITEM.sub("", line))
        yield "\n".join(lines)


def _sentences(file: Path, text: str) -> Iterator[Sentence]:
    for sentence in _END.split(" ".join(text.split())):
        if len(sentence.split()) >= FEWEST_WORDS:
            yield Sentence(str(file.relative_to(ROOT)), sentence)
