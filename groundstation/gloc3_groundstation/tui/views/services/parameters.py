"""Parameters as lines: the list, one of them in full, and the comparison with a file."""

from collections.abc import Collection, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Final

from gloc3.cli.counting import counted
from gloc3_groundstation.services.parameter_table import DiffKind, DiffRow, ParameterDiff, ParameterRow, ParameterTable
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, wrapped
from gloc3_groundstation.tui.widgets.tables import Column, table_of

CHANGED: Final = "●"
NOT_DEFAULT: Final = "≠"
COLUMNS: Final = (
    Column("", 1),
    Column("name", 16),
    Column("value", 12, is_right=True, grows=1, most=16),
    Column("unit", 6, rank=2),
    Column("meaning", 16, rank=1, grows=2, most=40),
    Column("default", 9, is_right=True, rank=3),
    Column("title", 20, rank=1, grows=3, most=70),
)
DIFF_COLUMNS: Final = (
    Column("", 5),
    Column("name", 16),
    Column("on vehicle", 10, is_right=True, grows=1, most=18),
    Column("in file", 10, is_right=True, grows=1, most=18),
    Column("", 28, rank=1, grows=3),
)
_VALUES_SHOWN: Final = 12


class Only(StrEnum):
    """Filters of the list; the text ends a sentence."""

    ALL = ""
    CHANGED = "changed since they were listed"
    NOT_DEFAULT = "not at their default"


def parameters_header(width: int) -> Line:
    """The titles of the columns."""
    return table_of(COLUMNS, width).header()


def parameter_line(row: ParameterRow, width: int) -> Line:
    """One parameter; ● was changed since the list was fetched, ≠ is not the firmware's default."""
    info = row.info
    mark = (
        Span(CHANGED, Tone.WARN)
        if row.is_changed
        else Span(NOT_DEFAULT, Tone.BUSY)
        if row.is_default is False
        else Span(" ")
    )
    tone = Tone.WARN if row.is_changed else Tone.TEXT
    default = f"{info.default:g}" if info.default is not None else ""
    return table_of(COLUMNS, width).line(
        [
            mark,
            Span(row.name, Tone.STRONG if row.is_changed else Tone.TEXT),
            Span(row.text, tone),
            Span(info.unit, Tone.DIM),
            Span(row.meaning),
            Span(default, Tone.DIM),
            Span(info.title, Tone.DIM),
        ]
    )


def parameters_title(table: ParameterTable, shown: int, text: str, only: Only) -> str:
    """How many are shown of how many, and why not all."""
    if not table.is_complete:
        return "parameters: not fetched"
    changed = sum(row.is_changed for row in table)
    parts = [f"{shown} of {len(table)} parameters" if shown != len(table) else counted(len(table), "parameter")]
    if text:
        parts.append(f"for {text!r}")
    if only:
        parts.append(str(only))
    return " ".join(parts) + (f", {changed} changed" if changed and only is not Only.CHANGED else "")


def parameter_lines(row: ParameterRow | None, width: int) -> list[Line]:
    """One parameter in full."""
    if row is None:
        return []
    info, unit = row.info, f" {row.info.unit}" if row.info.unit else ""
    meaning = f" ({row.meaning})" if row.meaning else ""
    lines: list[Line] = [
        (
            Span(f" {row.name} = {row.text}{unit}{meaning}", Tone.STRONG),
            Span(f"   was {_plain(row.first)}{unit}" if row.is_changed else "", Tone.WARN),
        )
    ]
    snapshot = [str(row.parameter.type.name).lower()]
    if info.minimum is not None or info.maximum is not None:
        snapshot.append(f"from {_plain(info.minimum)} to {_plain(info.maximum)}{unit}")
    if info.default is not None:
        snapshot.append(f"default {_plain(info.default)}{unit}")
    if info.increment is not None:
        snapshot.append(f"in steps of {_plain(info.increment)}")
    if info.is_read_only:
        snapshot.append("read-only")
    if info.needs_restart:
        snapshot.append("takes effect after a vehicle restart")
    lines.append((Span(f" {', '.join(snapshot)}", Tone.DIM),))
    if not info.title:
        lines.append((Span(" no description; i takes one from the vehicle or from a file", Tone.DIM),))
    else:
        lines += [(Span(f" {text}"),) for text in wrapped(info.title, width - 2)]
    choices = [f"{value:g} {text}" for value, text in list(info.values.items())[:_VALUES_SHOWN]]
    choices += [f"bit {bit} {text}" for bit, text in list(info.bits.items())[:_VALUES_SHOWN]]
    if choices:
        lines += [(Span(f" {text}", Tone.BUSY),) for text in wrapped(", ".join(choices), width - 2)]
    if info.description and info.description != info.title:
        lines += [(Span(f" {text}", Tone.DIM),) for text in wrapped(info.description, width - 2)]
    if info.origin:
        lines.append((Span(f" by {info.origin}; i takes the vehicle's own description", Tone.DIM),))
    return lines


# --- the comparison with a file ---


def diff_rows(diff: ParameterDiff) -> Sequence[DiffRow]:
    """What is worth showing: what would be written, then what cannot be."""
    return (
        *diff.of(DiffKind.DIFFERENT),
        *diff.of(DiffKind.NOT_ALLOWED),
        *diff.of(DiffKind.ONLY_IN_FILE),
    )


def diff_header(width: int) -> Line:
    """The titles of the columns."""
    return table_of(DIFF_COLUMNS, width).header()


def diff_line(row: DiffRow, left_out: Collection[str], width: int) -> Line:
    """One difference; its first character shows whether it will be written."""
    is_written = row.kind is DiffKind.DIFFERENT and row.name not in left_out
    if row.kind is DiffKind.DIFFERENT:
        sign, note = ("write", Tone.WARN) if is_written else ("leave", Tone.DIM), ""
    elif row.kind is DiffKind.NOT_ALLOWED:
        sign, note = ("wrong", Tone.BAD), row.reason.removeprefix(f"{row.name} ")
    else:
        sign, note = ("none", Tone.DIM), "not on the vehicle"
    return table_of(DIFF_COLUMNS, width).line(
        [
            Span(*sign),
            Span(row.name, Tone.STRONG if is_written else Tone.TEXT),
            Span(_plain(row.vehicle)),
            Span(_plain(row.file), Tone.WARN if is_written else Tone.DIM),
            Span(note, Tone.BAD if row.kind is DiffKind.NOT_ALLOWED else Tone.DIM),
        ]
    )


def diff_title(diff: ParameterDiff, left_out: Collection[str]) -> str:
    """What writing would do."""
    count, same = len(diff.changes(frozenset(left_out))), len(diff.of(DiffKind.SAME))
    what = f"{count} to write" if count else "nothing to write"
    return f"{Path(diff.file).name} against the vehicle: {what}, {same} the same"


def diff_detail(diff: ParameterDiff, row: DiffRow | None, width: int) -> list[Line]:
    """One difference in full, warnings about the file, and the keys."""
    lines: list[Line] = []
    if row is not None:
        where = f"line {row.line} of the file" if row.line else ""
        lines.append((Span(f" {row.name}", Tone.STRONG), Span(f"   {row.kind}   {where}", Tone.DIM)))
        lines += [(Span(f" {text}", Tone.BAD),) for text in wrapped(row.reason, width - 2) if row.reason]
    lines.append(EMPTY)
    keys = (("enter", "toggles it"), ("w", "writes what differs"), ("esc", "discards the changes"))
    lines.append(tuple(span for key, what in keys for span in (Span(f" {key}", Tone.KEY), Span(f" {what}  "))))
    for finding in diff.warnings:
        lines += [(Span(f" {text}", Tone.WARN),) for text in wrapped(str(finding), width - 2)]
    return lines


def _plain(value: float | None) -> str:
    if value is None:
        return "?"
    return f"{value:.0f}" if float(value).is_integer() and abs(value) < 1e15 else f"{value:.7g}"
