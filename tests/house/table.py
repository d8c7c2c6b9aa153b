"""Tables in Markdown, and docstrings as one line."""

import re
from collections.abc import Iterable, Iterator, Sequence


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Lines of a table."""
    yield f"| {' | '.join(head)} |"
    yield f"| {' | '.join('---' for _ in head)} |"
    for row in rows:
        cells = [" ".join(cell.split()).replace("|", r"\|") for cell in row]
        yield f"| {' | '.join(cells)} |"
    yield ""


def plain(text: str) -> str:
    """The text of a docstring before the arguments, on one line."""
    return " ".join(re.split(r"\n\s*\n(?=Args:|Raises:)", text)[0].split())


def as_text(text: str) -> str:
    """A text of a program as Markdown that shows it as it is."""
    return re.sub(r"([*_])", r"\\\1", text.replace("<", "&lt;"))
