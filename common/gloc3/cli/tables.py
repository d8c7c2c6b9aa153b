"""Output of commands: tables for people, JSON for programs."""

from collections.abc import Iterable, Sequence
from typing import Any, Final

import msgspec
from rich import box
from rich.console import Console
from rich.table import Table

from gloc3.component.description import FieldLine

WIDTH_WITHOUT_TERMINAL: Final = 120


def console() -> Console:
    """The terminal; where there is none, lines of a fixed width."""
    found = Console(highlight=False)
    return found if found.is_terminal else Console(highlight=False, width=WIDTH_WITHOUT_TERMINAL)


def print_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """A table, after an empty line."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for column in columns:
        table.add_column(column, overflow="fold", no_wrap=column == "class")
    for row in rows:
        table.add_row(*(cell.replace("[", r"\[") for cell in row))
    to = console()
    to.print()
    to.print(table)


def print_json(value: Any) -> None:
    """Anything that msgspec encodes."""
    data = msgspec.json.format(msgspec.json.encode(value), indent=2)
    console().out(data.decode(), highlight=False)


def default_text(field: FieldLine) -> str:
    """A field's default."""
    return "(required)" if field.is_required else value_text(field.default)


def value_text(value: Any) -> str:
    """A value in a cell."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value)
