"""A page of evidence: the claim, the command that shows it, and the figures that it gave."""

import subprocess
import sys
from collections.abc import Callable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "evidence"
INDEX = PAGES / "README.md"
RESULT = "- result: "
ABOUT = """\
Each page states a claim, the command that shows it, the commit at which it ran, and its figures with their bars.
`make evidence NAME=flight` writes one page again; `make evidence` writes all pages and this list."""
SCRATCH = ROOT / "runs" / "evidence"
SOURCES = ("common", "onboard", "groundstation", "sitl")


class Figure(NamedTuple):
    """One figure of a page."""

    name: str
    value: str
    bar: str = ""
    """What it must be; empty where it only informs."""
    is_met: bool = True


class Bar(NamedTuple):
    """One claim, and how it is shown."""

    name: str
    title: str
    claim: str
    run: Callable[["Progress"], Sequence[Figure]]
    seeds: str = "none"
    pictures: tuple[str, ...] = ()
    """Files that `run` writes, beside the page."""


class Progress:
    """Remembers the results of the parts of a long run, for the sources they belong to, so that it can be resumed.

    Args:
        name: of the page.
        basis: what the results belong to, as `basis` has it.
    """

    def __init__(self, name: str, basis: str) -> None:
        SCRATCH.mkdir(parents=True, exist_ok=True)
        self._name = name
        self.basis = basis
        self._file = SCRATCH / f"{name}-{basis}.jsonl"
        self._known: dict[str, Any] = {}
        if self._file.exists():
            for line in self._file.read_bytes().splitlines():
                key, result = msgspec.json.decode(line)
                self._known[key] = result

    def part(self, key: str, work: Callable[[], Any]) -> Any:
        """The result of a part: from the run before, or by doing it now."""
        if key not in self._known:
            result = msgspec.to_builtins(work())
            with self._file.open("ab") as file:
                file.write(msgspec.json.encode((key, result)) + b"\n")
            self._known[key] = result
        return self._known[key]

    def knows(self, key: str) -> bool:
        """Whether the result of a part is there."""
        return key in self._known

    def report(self, text: str) -> None:
        """Tells how far it is."""
        print(f"{self._name}: {text}", file=sys.stderr, flush=True)


def commit() -> str:
    """The commit that is shown, marked when files differ from it."""
    head = _git("rev-parse", "--short", "HEAD")
    dirty = _git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!docs/evidence")
    return f"{head}-changed" if dirty else head


def basis(module: str) -> str:
    """What results of a page belong to: the sources, and the file that makes the page; marked when they are changed.

    Commits of documents, of other pages and of tests change nothing, so that a run that takes hours goes on after them.

    Args:
        module: the name of the page's module, such as `tests.evidence.campaign`.
    """
    paths = [*SOURCES, f"{module.replace('.', '/')}.py"]
    found = _git("rev-parse", *(f"HEAD:{path}" for path in paths))
    dirty = _git("status", "--porcelain", "--untracked-files=no", "--", *paths)
    return sha256(found.encode()).hexdigest()[:9] + ("-changed" if dirty else "")


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()


def write(bar: Bar, figures: Sequence[Figure], of: str) -> bool:
    """Writes the page; returns whether every figure meets its bar."""
    is_met = all(figure.is_met for figure in figures)
    rows = [
        f"| {figure.name} | {figure.value} | {figure.bar} | {'' if not figure.bar else 'yes' if figure.is_met else '**no**'} |"
        for figure in figures
    ]
    lines = [
        *_head(bar),
        "",
        f"- command: `make evidence NAME={bar.name}`",
        f"- commit: `{of}`",
        f"- seeds: {bar.seeds}",
        f"{RESULT}{'every bar is met' if is_met else '**not every bar is met**'}",
        "",
        "| figure | value | bar | met |",
        "| --- | --- | --- | --- |",
        *rows,
        "",
        *(line for name in bar.pictures for line in (f"![{Path(name).stem.replace('_', ', ')}]({name})", "")),
    ]
    PAGES.mkdir(parents=True, exist_ok=True)
    (PAGES / f"{bar.name}.md").write_text("\n".join(lines))
    write_index()
    return is_met


def _head(bar: Bar) -> list[str]:
    """The first lines of a page."""
    return [f"# {bar.title}", "", bar.claim]


def retitle(bars: Sequence[Bar]) -> None:
    """Gives the pages the titles and claims that their bars have now; their figures stay those of their commits."""
    for bar in bars:
        page = PAGES / f"{bar.name}.md"
        if page.exists():
            head = _head(bar)
            page.write_text("\n".join([*head, *page.read_text().split("\n")[len(head) :]]))
    write_index()


def write_index() -> None:
    """Writes the list of all pages."""
    INDEX.write_text(index())


def index() -> str:
    """The list of all pages, with their titles and results."""
    rows = []
    for page in sorted(PAGES.glob("*.md")):
        if page != INDEX:
            title, *lines = page.read_text().splitlines()
            result = next(line.removeprefix(RESULT) for line in lines if line.startswith(RESULT))
            rows.append(f"| [{title.removeprefix('# ')}]({page.name}) | {result} |")
    return "\n".join(["# Evidence", "", ABOUT, "", "| claim | result |", "| --- | --- |", *rows, ""])
