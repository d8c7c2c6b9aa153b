"""Tables as lines: columns keep their position, grow with the terminal, and are dropped in a given order."""

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Final, NamedTuple

from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, cut

GAP: Final = 2
"""Blanks between columns."""


class Column(NamedTuple):
    """A column."""

    title: str
    width: int
    """Characters that it has at least."""
    rank: int = 0
    """Columns of the highest rank go first where there is no room; those of rank 0 never."""
    grows: int = 0
    """Its share of the room that is left over."""
    is_right: bool = False
    """Aligned at the right, as numbers are."""
    most: int = 1000
    """Largest number of characters, so that related columns stay close together on wide terminals."""


def with_names(columns: tuple[Column, ...], title: str, names: Iterable[str], width: int) -> tuple[Column, ...]:
    """The columns with one as wide as its longest name, as far as those that are never dropped leave room for it.

    Args:
        columns: all of them.
        title: of the column of names.
        names: those that it is to hold.
        width: characters of a line.
    """
    kept = [column for column in columns if column.rank == 0]
    spare = width - 1 - sum(column.width for column in kept) - GAP * (len(kept) - 1)
    longest = max(map(len, names), default=0)

    def fitted(column: Column) -> Column:
        wanted = min(longest, column.width + max(0, spare), column.most)
        return column._replace(width=max(column.width, wanted))

    return tuple(fitted(column) if column.title == title else column for column in columns)


class FittedTable:
    """The columns that fit a width."""

    def __init__(self, columns: Sequence[Column], width: int, indent: int = 1) -> None:
        """Lays the columns out.

        Args:
            columns: all of them, from left to right.
            width: characters of a line.
            indent: blanks before the first.
        """
        self._indent = " " * indent
        shown = list(range(len(columns)))

        def needed() -> int:
            return indent + sum(columns[n].width for n in shown) + GAP * (len(shown) - 1)

        while needed() > width and (rank := max(columns[n].rank for n in shown)) > 0:
            shown.remove(max(n for n in shown if columns[n].rank == rank))
        spare = max(0, width - needed())
        shares = max(1, sum(columns[n].grows for n in shown))
        self._columns = [
            (n, columns[n]._replace(width=min(columns[n].most, columns[n].width + spare * columns[n].grows // shares)))
            for n in shown
        ]

    def shows(self, title: str) -> bool:
        """Whether a column has room."""
        return any(column.title == title for _, column in self._columns)

    def header(self) -> Line:
        """The titles."""
        return self._line([Span(column.title, Tone.DIM) for _, column in self._columns])

    def line(self, cells: Sequence[Span]) -> Line:
        """A row: a span for each column, also for those that have no room."""
        return self._line([cells[n] for n, _ in self._columns])

    def _line(self, cells: Sequence[Span]) -> Line:
        spans = [Span(self._indent)]
        for place, (cell, (_, column)) in enumerate(zip(cells, self._columns, strict=True)):
            text = cut(cell.text, column.width)
            text = f"{text:>{column.width}}" if column.is_right else f"{text:<{column.width}}"
            spans.append(Span(text, cell.tone))
            if place < len(self._columns) - 1:
                spans.append(Span(" " * GAP))
        return tuple(spans)


@lru_cache(maxsize=64)
def table_of(columns: tuple[Column, ...], width: int) -> FittedTable:
    """A table for a width, laid out once for all its lines."""
    return FittedTable(columns, width)
