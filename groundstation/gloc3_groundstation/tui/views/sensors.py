"""Topics of a platform, the last message of one of them field by field, its numbers over time, and scans from above."""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from gloc3.messages.watch import Preview, TopicActivity, TopicEntry
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.message_fields import FieldValue, fields_of
from gloc3_groundstation.station.watches import Sight
from gloc3_groundstation.tui.widgets.canvas import CellCanvas
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, column, cut, spread, wrapped
from gloc3_groundstation.tui.widgets.tables import Column, table_of

COLUMNS: Final = (
    Column("topic", 16, grows=3, most=34),
    Column("type", 16, rank=2, grows=1, most=20),
    Column("Hz", 5, is_right=True),
    Column("of", 4, rank=3, is_right=True),
    Column("age", 6, rank=1, is_right=True),
)
STALE_S: Final = 3.0
"""Age from which a periodic topic is marked as old, if it is also older than three of its periods."""
LABEL: Final = 18
NARROW: Final = 52
NARROW_LABEL: Final = 14
POINTS: Final = "points_ne_m"
"""A message with this field is a scan: metres north and east."""
AXES: Final = ("x", "y", "z")


def topics_header(width: int) -> Line:
    """The titles of the columns."""
    return table_of(COLUMNS, width).header()


def topic_rows(
    entries: Sequence[TopicEntry], activity: TopicActivity | None, wanted: str, width: int
) -> list[tuple[str, Line]]:
    """Topics that match a filter, each with its name.

    Args:
        entries: all topics.
        activity: their activity, in the same order; None while it is unknown.
        wanted: part of a topic's name, type or source.
        width: columns.
    """
    table, found = table_of(COLUMNS, width), []
    for index, entry in enumerate(entries):
        if not any(wanted.lower() in text.lower() for text in (entry.name, entry.type, entry.source)):
            continue
        is_known = activity is not None and index < min(len(activity.rates), len(activity.ages))
        rate_hz = activity.rates[index] / 10.0 if activity is not None and is_known else 0.0
        age_s = activity.ages[index] / 10.0 if activity is not None and is_known else -1.0
        is_silent = entry.rate_hz > 0.0 and is_known and (age_s < 0.0 or age_s > max(STALE_S, 3.0 / entry.rate_hz))
        tone = Tone.STALE if is_silent else Tone.TEXT if age_s >= 0.0 else Tone.DIM
        cells = [
            Span(entry.name, tone),
            Span(entry.type, Tone.DIM),
            Span(f"{rate_hz:.1f}" if age_s >= 0.0 else "·", tone),
            Span(f"{entry.rate_hz:g}" if entry.rate_hz else "", Tone.DIM),
            Span(wording.duration(age_s) if age_s >= 0.0 else "silent" if is_silent else "", tone),
        ]
        found.append((entry.name, table.line(cells)))
    return found


def no_topics_lines(entries: Sequence[TopicEntry], wanted: str, problem: str, width: int) -> list[Line]:
    """Why no topic is shown; the first line is a topic that is requested by its name."""
    if entries:
        return [(Span(f" {wanted}"),), *text_lines("not listed, requested by name", width)]
    if problem:
        return text_lines(problem, width, Tone.WARN)
    return text_lines("requesting the list of topics…", width)


def sight_line(sight: Sight, wanted_hz: float, now_s: float, width: int) -> Line:
    """Rate of the watched topic, and the share that arrives."""
    if sight.problem:
        return (Span(cut(f" {sight.problem}", width), Tone.WARN),)
    if sight.envelope is None:
        return (Span(" nothing received yet", Tone.DIM),)
    age_s = now_s - sight.received_s
    is_stale = age_s > max(STALE_S, 3.0 / wanted_hz)
    speaks = f" publishes {sight.source_rate_hz:.1f} Hz, received {sight.rate_hz:.1f} of {wanted_hz:g} Hz"
    age = f"{wording.duration(age_s)} ago" if age_s >= 1.0 else "now"
    return spread(
        (Span(speaks, Tone.STALE if is_stale else Tone.DIM),),
        (Span(f"{age} ", Tone.STALE if is_stale else Tone.DIM),),
        width,
    )


def field_rows(message: Any, width: int, is_stale: bool = False) -> list[tuple[str, Line]]:
    """A message field by field, each with its path."""
    return [(field.path, _field_line(field, width, is_stale)) for field in fields_of(message)]


def preview_line(preview: Preview) -> str:
    """What a preview shows; empty for one without a picture."""
    if not preview.width:
        return ""
    return f"{preview.camera}: {preview.width}×{preview.height} of {preview.full_width}×{preview.full_height}"


def plot_lines(series: Sequence[tuple[float, tuple[float, ...]]], width: int, height: int) -> list[Line]:
    """Numbers over time, each in a separate strip with its range at the left; the newest at the right.

    Args:
        series: times and numbers, oldest first.
        width: columns.
        height: lines.
    """
    if len(series) < 2 or height < 2:
        return [(Span(" waiting for more samples to plot" if height >= 1 else "", Tone.DIM),)]
    count = min(len(series[-1][1]), max(1, height // 2))
    lines: list[Line] = []
    for index in range(count):
        rows = height // count
        points = [
            (t_s, numbers[index]) for t_s, numbers in series if index < len(numbers) and math.isfinite(numbers[index])
        ]
        name = AXES[index] if 1 < len(series[-1][1]) <= len(AXES) else str(index) if len(series[-1][1]) > 1 else ""
        lines += _strip(points, name, width, rows)
    return lines


def scan_lines(points_ne_m: Sequence[tuple[float, float]], width: int, height: int) -> list[Line]:
    """Hits of a scanner from above: north up, the same scale on both axes."""
    if not points_ne_m or height < 2:
        return [(Span(" no hits", Tone.DIM),)]
    canvas = CellCanvas(max(1, width), height - 1)
    across_dots, down_dots = canvas.size
    north = [point[0] for point in points_ne_m]
    east = [point[1] for point in points_ne_m]
    middle = (max(north) + min(north)) / 2.0, (max(east) + min(east)) / 2.0
    metres = max((max(north) - min(north)) / (down_dots - 1), (max(east) - min(east)) / (across_dots - 1), 1e-3)
    x = (np.array(east) - middle[1]) / metres + across_dots / 2.0
    y = (middle[0] - np.array(north)) / metres + down_dots / 2.0
    canvas.points(np.column_stack((x, y)), Tone.TEXT)
    across = f"{len(points_ne_m)} points, {max(east) - min(east):.1f} × {max(north) - min(north):.1f} m, north is up"
    return [*canvas.lines(), (Span(cut(f" {across}", width), Tone.DIM),)]


def _strip(points: Sequence[tuple[float, float]], name: str, width: int, rows: int) -> list[Line]:
    if not points:
        return [(Span(f" {name}: no number", Tone.DIM),)] * rows
    low, high = min(value for _, value in points), max(value for _, value in points)
    label = max(len(_number(low)), len(_number(high))) + len(name) + 2
    canvas = CellCanvas(max(1, width - label - 1), rows)
    across, down = canvas.size
    first_s, last_s = points[0][0], points[-1][0]
    span_s, span = max(1e-9, last_s - first_s), max(1e-12, high - low)
    shares = [(value - low) / span if high > low else 0.5 for _, value in points]
    corners = [
        (round((t_s - first_s) / span_s * (across - 1)), round((1.0 - share) * (down - 1)))
        for (t_s, _), share in zip(points, shares, strict=True)
    ]
    canvas.line(corners, Tone.TEXT)
    labels = [""] * rows
    labels[0], labels[-1] = (
        (_number(high), _number(low)) if rows > 1 else (_number(points[-1][1]), _number(points[-1][1]))
    )
    return [
        (
            Span(f"{(name if row == 0 else ''):<{len(name) + 1}}{labels[row]:>{label - len(name) - 1}} ", Tone.DIM),
            *spans,
        )
        for row, spans in enumerate(canvas.lines())
    ]


def _field_line(field: FieldValue, width: int, is_stale: bool) -> Line:
    label = NARROW_LABEL if width < NARROW else LABEL
    name = column(f" {'  ' * field.depth}{field.label.replace('_', ' ')}", label)
    if field.is_group:
        return (Span(name, Tone.DIM),)
    tone = Tone.STALE if is_stale else Tone.TEXT
    return (Span(name, Tone.DIM), Span(cut(f" {_value(field)}", width - label), tone))


def _value(field: FieldValue) -> str:
    value = field.value
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        items = [_number(item) if isinstance(item, float) else str(item) for item in value]
        joined = " ".join(f"{item:>7}" if field.numbers else item for item in items) or "none"
        return f"{joined} {field.unit}".rstrip()
    text = _number(value) if isinstance(value, float) else " ".join(str(value).split()) or "–"
    return f"{text} {field.unit}".rstrip()


def _number(value: float) -> str:
    if not math.isfinite(value):
        return str(value)
    return f"{value:.3f}" if abs(value) < 1000.0 else f"{value:.1f}" if abs(value) < 1e6 else f"{value:.3g}"


def text_lines(text: str, width: int, tone: Tone = Tone.DIM) -> list[Line]:
    """A text in lines."""
    return [(Span(f" {row}", tone),) for row in wrapped(text, width - 2)]
