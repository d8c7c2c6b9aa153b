"""Logs, files and message rates of a vehicle as tables."""

from typing import Final

from gloc3_groundstation.services.files import Folder
from gloc3_groundstation.services.logs import LogLine
from gloc3_groundstation.services.rates import RateRow, RateTable
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone
from gloc3_groundstation.tui.widgets.tables import Column, table_of

LOG_COLUMNS: Final = (
    Column("number", 6, is_right=True),
    Column("start (UTC)", 16),
    Column("size", 9, is_right=True),
    Column("saved as", 34, grows=1, most=50),
)
FILE_COLUMNS: Final = (Column("name", 40, grows=1, most=90), Column("size", 9, is_right=True))
RATE_COLUMNS: Final = (
    Column("message", 26, grows=2, most=40),
    Column("from", 7),
    Column("rate Hz", 7, is_right=True),
    Column("asked", 6, is_right=True),
    Column("bytes/s", 8, is_right=True),
    Column("last", 7, is_right=True, rank=1),
    Column("count", 8, is_right=True, rank=2),
)
STALE_S: Final = 5.0
ABOVE: Final = "parent folder"


def size_text(size: int) -> str:
    """`812 B`, `12.3 kB`, `4.56 MB`."""
    if size < 1000:
        return f"{size} B"
    return f"{size / 1e3:.1f} kB" if size < 1_000_000 else f"{size / 1e6:.2f} MB"


def logs_header(width: int) -> Line:
    """The titles of the columns."""
    return table_of(LOG_COLUMNS, width).header()


def log_line(log: LogLine, width: int) -> Line:
    """One log."""
    cells = [
        Span(str(log.entry.number), Tone.STRONG),
        Span(log.begun or "not known", Tone.TEXT if log.begun else Tone.STALE),
        Span(size_text(log.entry.size)),
        Span(log.file_name, Tone.DIM),
    ]
    return table_of(LOG_COLUMNS, width).line(cells)


def logs_title(logs: tuple[LogLine, ...] | None) -> str:
    """How many there are, and how much."""
    if logs is None:
        return "logs: not listed"
    return f"{len(logs)} logs, {size_text(sum(log.entry.size for log in logs))}, the newest first"


def files_header(width: int) -> Line:
    """The titles of the columns."""
    return table_of(FILE_COLUMNS, width).header()


def file_line(name: str, size: int | None, width: int) -> Line:
    """One file, or a folder (no size)."""
    is_folder = size is None
    text = f"{name}/" if is_folder and name != ".." else name
    cells = [Span(text, Tone.BUSY if is_folder else Tone.TEXT), Span("" if size is None else size_text(size))]
    return table_of(FILE_COLUMNS, width).line(cells)


def files_title(folder: Folder | None) -> str:
    """Path of the folder on the vehicle."""
    return "files: not listed" if folder is None else f"on the vehicle: {folder.path}"


def rates_header(width: int) -> Line:
    """The titles of the columns."""
    return table_of(RATE_COLUMNS, width).header()


def rate_line(row: RateRow, width: int) -> Line:
    """One message."""
    is_stale = row.age_s >= STALE_S
    wanted = "" if row.wanted_hz is None else "off" if row.wanted_hz == 0 else f"{row.wanted_hz:g}"
    missed = row.wanted_hz is not None and row.wanted_hz > 0 and row.rate_hz < 0.7 * row.wanted_hz
    cells = [
        Span(row.name, Tone.STALE if is_stale else Tone.TEXT),
        Span(f"{row.source.system}/{row.source.component}", Tone.DIM),
        Span(f"{row.rate_hz:.1f}", Tone.STALE if is_stale else Tone.WARN if missed else Tone.TEXT),
        Span(wanted, Tone.BUSY),
        Span(f"{row.bytes_s:.0f}", Tone.STALE if is_stale else Tone.TEXT),
        Span(f"{row.age_s:.0f} s" if row.age_s >= 1.0 else "now", Tone.STALE if is_stale else Tone.DIM),
        Span(str(row.count), Tone.DIM),
    ]
    return table_of(RATE_COLUMNS, width).line(cells)


def rates_title(table: RateTable, shown: int, text: str) -> str:
    """Bandwidth of all messages on the link."""
    found = f"{shown} of {len(table.rows)} messages for {text!r}" if text else f"{len(table.rows)} messages"
    return f"{found}, {table.total_hz:.0f} a second, {size_text(round(table.total_bytes_s))}/s on the link"
