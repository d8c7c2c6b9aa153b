"""Events as lines, newest last; a table of those that match a filter; one in full."""

from collections.abc import Sequence
from typing import Final

from gloc3.messages.envelope import Severity
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.snapshots import Fleet, FleetEvent
from gloc3_groundstation.store.event_search import STATION, EventFilter, Search
from gloc3_groundstation.tui.views.chrome import tone_of
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, cut, fitted, joined, spread, text_of, wrapped
from gloc3_groundstation.tui.widgets.tables import Column, table_of

SHOWN = 200
COLUMNS: Final = (
    Column("time", 7, is_right=True),
    Column("severity", 9),
    Column("vehicle", 8, rank=1, grows=1, most=16),
    Column("component", 14, grows=1, most=20),
    Column("event", 30, grows=8),
)
SEVERITIES: Final = (Severity.DEBUG, Severity.NOTICE, Severity.WARNING, Severity.ERROR, Severity.CRITICAL)
"""What the filter can be set to, from everything to the worst."""


def event_lines(fleet: Fleet, start_s: float, width: int) -> list[Line]:
    """The last events; long ones are wrapped.

    Args:
        fleet: source of the events.
        start_s: start of the station, from which times are counted.
        width: columns.
    """
    lines: list[Line] = []
    for event in fleet.events[-SHOWN:]:
        lines += _lines(event, len(fleet.platforms) > 1, start_s, width)
    return lines or [(Span(" Nothing has happened yet.", Tone.DIM),)]


def filter_line(wanted: EventFilter, search: Search, total: int, width: int) -> Line:
    """The filter, and the number of matches."""
    parts = [(0, _choice("severity", severity_name(wanted.severity), wanted.severity is not Severity.DEBUG))]
    parts += [
        (2, _choice("vehicle", wanted.platform or "all", bool(wanted.platform))),
        (2, _choice("component", wanted.component or "all", bool(wanted.component))),
        (1, _choice("text", f"“{wanted.text}”" if wanted.text else "any", bool(wanted.text))),
    ]
    found = f"{len(search):,}" if wanted.is_everything else f"{len(search):,} of {total:,}"
    if not search.is_done:
        found += f", {search.share * 100.0:.0f} % searched"
    right = (Span(f"{found} ", Tone.DIM),)
    return spread((Span(" "), *fitted(parts, width - len(text_of(right)) - 4)), right, width)


def severity_name(severity: Severity) -> str:
    """`warning and worse`, in a word or two."""
    return "all" if severity is Severity.DEBUG else f"{severity.name.lower()}+"


def event_header(width: int) -> Line:
    """The titles of the columns."""
    return table_of(COLUMNS, width).header()


def event_rows(events: Sequence[FleetEvent], start_s: float, width: int) -> list[Line]:
    """One line for each event."""
    table = table_of(COLUMNS, width)
    rows = []
    for event in events:
        tone = tone_of(event.severity)
        is_loud = event.severity <= Severity.WARNING
        rows.append(
            table.line(
                [
                    Span(wording.clock(event.received_s - start_s), Tone.DIM),
                    Span(event.severity.name.lower(), tone if is_loud else Tone.DIM),
                    Span(event.platform, Tone.DIM),
                    Span(event.source or STATION, Tone.DIM),
                    Span(" ".join(event.text.split()), Tone.TEXT if is_loud and tone is not Tone.BAD else tone),
                ]
            )
        )
    return rows


def no_events_line(wanted: EventFilter, search: Search) -> Line:
    """Why nothing is shown."""
    if not search.is_done:
        return (Span(" Searching…", Tone.DIM),)
    text = "Nothing has happened yet." if wanted.is_everything else "No event matches; esc shows all."
    return (Span(f" {text}", Tone.DIM),)


def event_detail(event: FleetEvent | None, start_s: float, now_s: float, width: int) -> list[Line]:
    """One event in full."""
    if event is None:
        return []
    ago = wording.duration(now_s - event.received_s)
    parts = [
        Span(f" {event.severity.name.lower()}", tone_of(event.severity)),
        Span(event.platform or "no vehicle", Tone.DIM),
        Span(event.source or STATION, Tone.DIM),
        Span(f"{wording.clock(event.received_s - start_s)}, {ago} ago", Tone.DIM),
    ]
    return [joined(parts), *((Span(f"   {row}"),) for row in wrapped(event.text, width - 5))]


def _choice(name: str, value: str, is_set: bool) -> Span:
    return Span(cut(f"{name} {value}", 32), Tone.CHOSEN if is_set else Tone.DIM)


def _lines(event: FleetEvent, has_many: bool, start_s: float, width: int) -> list[Line]:
    clock = f" {wording.clock(event.received_s - start_s)}  "
    who = f"{event.platform}: " if event.platform and (has_many or not event.source) else ""
    who += f"{event.source}: " if event.source else ""
    grade = f"{event.severity.name.lower()}: " if event.severity <= Severity.WARNING else ""
    rows = wrapped(grade + who + event.text, width - len(clock))
    tone = tone_of(event.severity)
    indent = " " * len(clock)
    return [(Span(clock if n == 0 else indent, Tone.DIM), Span(text, tone)) for n, text in enumerate(rows)]
