"""Flight data: attitude and current values, and strip charts of setpoints against measured values."""

from collections.abc import Sequence
from math import cos, isnan, radians, sqrt, tan
from typing import Final, NamedTuple

from gloc3_groundstation.mapping.history import HistorySeries
from gloc3_groundstation.mapping.tracks import Track, TrackChannel
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.charts import (
    AXIS,
    ChartWindow,
    Curve,
    Scale,
    chart_lines,
    chart_title,
    duration,
    scale_of,
    time_axis,
    window_at,
)
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone

WINDOWS_S: Final = (10.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 7200.0, 28800.0)
"""The times that a chart can show."""
CHART_LINES: Final = 5
"""Of a chart, with its title; it grows where there is room."""
MOST_LINES: Final = 12
TWO_COLUMNS: Final = 130
"""Width from which charts are shown side by side."""
STALE_S: Final = 2.5
SURE: Final = 2.0
"""Standard deviations in a displayed uncertainty."""
DEGREES_PER_LINE: Final = 5.0
STEEPEST_DEG: Final = 88.0
EIGHTHS: Final = " ▁▂▃▄▅▆▇█"
VEHICLE: Final = "━━╸◦╺━━"


class ChartRow(NamedTuple):
    """A chart, as data."""

    name: str
    unit: str
    channel: TrackChannel
    decimals: int
    least: float
    """Least range of the axis."""
    wanted: TrackChannel | None = None
    """What it should be."""
    second: tuple[str, TrackChannel] | None = None
    """Another channel in the same chart, with its name."""
    wrap: float = 0.0


CHARTS: Final = (
    ChartRow("height", "m", TrackChannel.HEIGHT, 2, 1.0, TrackChannel.WANTED_HEIGHT),
    ChartRow("speed", "m/s", TrackChannel.SPEED, 2, 1.0, TrackChannel.WANTED_SPEED),
    ChartRow("heading", "°", TrackChannel.HEADING, 0, 20.0, TrackChannel.WANTED_HEADING, wrap=360.0),
    ChartRow("climb", "m/s", TrackChannel.CLIMB, 2, 0.5, TrackChannel.WANTED_CLIMB),
    ChartRow("x", "m", TrackChannel.X, 2, 1.0, TrackChannel.WANTED_X),
    ChartRow("y", "m", TrackChannel.Y, 2, 1.0, TrackChannel.WANTED_Y),
    ChartRow("roll", "°", TrackChannel.ROLL, 1, 10.0, second=("pitch", TrackChannel.PITCH)),
    ChartRow("battery", "V", TrackChannel.BATTERY_V, 2, 1.0),
    ChartRow("current", "A", TrackChannel.BATTERY_A, 1, 5.0),
    ChartRow("battery", "%", TrackChannel.BATTERY_PERCENT, 0, 10.0),
)


def shown_charts(width: int, height: int) -> int:
    """How many charts there is room for."""
    rows = max(1, (height - 1) // CHART_LINES)
    return min(len(CHARTS), rows * (2 if width >= TWO_COLUMNS else 1))


def charts(
    track: Track | None, end_s: float, now_s: float, window_s: float, first: int, width: int, height: int
) -> list[Line]:
    """As many charts as there is room for.

    Args:
        track: of the vehicle; None while nothing is known of it.
        end_s: the time up to which they show; now, or when they were frozen.
        now_s: the time.
        window_s: how much time they show.
        first: the first chart that is shown.
        width: columns.
        height: lines.
    """
    if track is None:
        return [(Span(" no data from this vehicle yet", Tone.STALE),)]
    columns = 2 if width >= TWO_COLUMNS else 1
    each = (width - 3 * (columns - 1)) // columns
    rows = CHARTS[first : first + shown_charts(width, height)]
    lines_each = -(-len(rows) // columns)
    is_stale = end_s >= now_s and silent_s(track, now_s) > 0.0
    size = max(3, min(MOST_LINES, (height - 1) // max(1, lines_each)))
    window = window_at(end_s, window_s, each - AXIS)
    stacks = []
    for column in range(columns):
        stack: list[Line] = []
        for row in rows[column * lines_each : (column + 1) * lines_each]:
            stack += chart(row, track, window, each, size, is_stale=is_stale)
        stacks.append([*stack, time_axis(window, now_s if end_s < now_s else window.to_s, each)] if stack else [])
    if columns == 1:
        return stacks[0]
    longest = max(len(stack) for stack in stacks)
    blank: Line = (Span(" " * each),)
    left, right = ([*stack, *[blank] * (longest - len(stack))] for stack in stacks)
    return [(*one, Span("   "), *other) for one, other in zip(left, right, strict=True)]


def silent_s(track: Track, now_s: float) -> float:
    """Time without new data, if the displayed data is stale; else 0."""
    age_s = 0.0 if track.latest_s is None else now_s - track.latest_s
    return age_s if age_s >= STALE_S else 0.0


def chart(
    row: ChartRow, track: Track, window: ChartWindow, width: int, height: int, *, is_stale: bool = False
) -> list[Line]:
    """One chart: setpoints dotted, actual values as a line; its newest values are marked where they are stale."""
    points = 2 * (width - AXIS)
    curves: list[Curve] = []
    about = track.series(row.channel, *window, points).last if row.wrap else None
    values: list[tuple[str, str, Tone]] = []
    if row.wanted is not None:
        wanted = Curve("wanted", track.series(row.wanted, *window, points), Tone.TEXT, is_dotted=True)
        curves.append(wanted)
        values.append(("wanted", _reported(wanted.series.last, row.decimals), Tone.TEXT))
    if row.second is not None:
        name, channel = row.second
        second = Curve(name, track.series(channel, *window, points), Tone.SECOND)
        curves.append(second)
        values.append((name, _reported(second.series.last, row.decimals), Tone.SECOND))
    own = Curve("", track.series(row.channel, *window, points), Tone.FIRST)
    curves.append(own)
    values.insert(0, ("" if row.second is None else row.name, _reported(own.series.last, row.decimals), Tone.FIRST))
    scale = scale_of(curves, window, row.least)
    if about is not None:
        near = [curve._replace(series=_around(curve.series, about, row.wrap)) for curve in curves]
        scale = scale_of(near, window, row.least)
        if scale.high - scale.low <= row.wrap / 2.0:
            curves = near
        else:  # all round: from north to north
            scale = Scale(0.0, row.wrap, 0)
    if is_stale:
        values = [(f"was {label}".rstrip(), value, Tone.STALE) for label, value, _ in values]
    title = chart_title(row.name, row.unit, values, width)
    return chart_lines(title, curves, window, scale, width, height, row.wrap)


def _around(series: HistorySeries, about: float, wrap: float) -> HistorySeries:
    """Directions as near to one of them as they are, so that they do not jump at north."""
    half = wrap / 2.0
    lows, highs = ((values - about + half) % wrap + about - half for values in (series.lows, series.highs))
    return series._replace(lows=lows, highs=highs)


def charts_title(track: Track | None, end_s: float, now_s: float, window_s: float, *, is_frozen: bool) -> str:
    """Displayed time range, whether it is frozen, and the time without new data."""
    span, stale_s = duration(window_s), silent_s(track, now_s) if track is not None else 0.0
    if is_frozen:
        return f"{span}, FROZEN {duration(max(0.0, now_s - end_s))} ago"
    return f"last {span}" + (f", no data for {duration(stale_s)}" if stale_s else "")


def attitude_lines(view: StationView, track: Track | None, width: int, height: int) -> list[Line]:
    """The horizon, and the current values."""
    if track is None or track.latest_s is None:
        return [(Span(" no data yet", Tone.STALE),)]
    latest, is_stale = track.latest, view.now_s - track.latest_s >= STALE_S
    values = {channel: float(latest[channel]) for channel in TrackChannel}
    for channel in (TrackChannel.HEADING, TrackChannel.WANTED_HEADING):
        values[channel] = round(values[channel], 0) % 360.0  # 359.7 is north
    snapshot = _figures(view, values)
    lines: list[Line] = []
    room = height - len(snapshot) - 1
    if not isnan(values[TrackChannel.ROLL]) and room >= 3:
        size = min(room, 11 if width < 40 else 15)
        size -= 1 - size % 2
        lines += horizon_lines(values[TrackChannel.ROLL], values[TrackChannel.PITCH], width, size, is_stale=is_stale)
        lines.append(())
    for name, spans in snapshot:
        toned = tuple(Span(span.text, Tone.STALE) for span in spans) if is_stale else spans
        lines.append((Span(f" {name:<8}", Tone.DIM), *toned))
    return lines


def attitude_title(view: StationView, track: Track | None) -> str:
    """The vehicle, and the age of its values where they are stale."""
    name = view.platform.name if view.platform is not None else "flight data"
    if track is None or track.latest_s is None or view.now_s - track.latest_s < STALE_S:
        return name
    return f"{name}, {duration(view.now_s - track.latest_s)} ago"


def _figures(view: StationView, values: dict[TrackChannel, float]) -> Sequence[tuple[str, Line]]:
    def reported(channel: TrackChannel, decimals: int, unit: str) -> Span:
        return Span(_reported(values[channel], decimals) + unit, Tone.STRONG)

    def wanted(channel: TrackChannel, decimals: int) -> Span:
        value = values[channel]
        return Span("" if isnan(value) else f"  wanted {_reported(value, decimals)}", Tone.DIM)

    motion = view.platform.motion.value if view.platform is not None and view.platform.motion is not None else None
    covariance = motion.covariance_cm2 if motion is not None else None
    snapshot: list[tuple[str, Line]] = [
        (
            "roll",
            (reported(TrackChannel.ROLL, 1, "°"), Span("  pitch ", Tone.DIM), reported(TrackChannel.PITCH, 1, "°")),
        ),
        ("heading", (reported(TrackChannel.HEADING, 0, "°"), wanted(TrackChannel.WANTED_HEADING, 0))),
        ("height", (reported(TrackChannel.HEIGHT, 2, " m"), wanted(TrackChannel.WANTED_HEIGHT, 2))),
        ("climb", (reported(TrackChannel.CLIMB, 2, " m/s"),)),
        ("speed", (reported(TrackChannel.SPEED, 2, " m/s"), wanted(TrackChannel.WANTED_SPEED, 2))),
        ("x, y", (reported(TrackChannel.X, 2, ""), Span("  "), reported(TrackChannel.Y, 2, " m"))),
    ]
    if motion is not None and covariance is not None:
        across_m = SURE * sqrt(max(covariance[0], covariance[2])) / 100.0
        up_m = SURE * motion.height_std_cm / 100.0
        snapshot.append(("± x, y", (Span(f"{across_m:.2f} m"), Span(f"  height {up_m:.2f} m", Tone.DIM))))
    level = reported(TrackChannel.BATTERY_PERCENT, 0, " %")
    voltage, current = values[TrackChannel.BATTERY_V], values[TrackChannel.BATTERY_A]
    supply = "" if isnan(voltage) else f"  {voltage:.2f} V  {_reported(current, 1)} A"
    snapshot.append(("battery", (level, Span(supply, Tone.DIM))))
    return snapshot


def _reported(value: float | None, decimals: int) -> str:
    return "?" if value is None or isnan(value) else f"{round(value, decimals) + 0.0:.{decimals}f}"


def horizon_lines(roll_deg: float, pitch_deg: float, width: int, height: int, *, is_stale: bool = False) -> list[Line]:
    """Horizon as seen from the vehicle: it sinks when the nose rises, and turns to the left in a roll to the right.

    Args:
        roll_deg: positive to the right.
        pitch_deg: positive with the nose up.
        width: columns.
        height: lines.
        is_stale: whether the values are stale.
    """
    roll = (roll_deg + 180.0) % 360.0 - 180.0
    is_inverted = abs(roll) > 90.0
    turn = roll - (180.0 if roll > 0.0 else -180.0) if is_inverted else roll
    turn = max(-STEEPEST_DEG, min(STEEPEST_DEG, turn))
    slope = tan(radians(turn)) / 2.0  # a cell is twice as high as it is wide
    sunk = pitch_deg / DEGREES_PER_LINE / max(0.1, cos(radians(turn)))
    middle = height / 2.0 + (-sunk if is_inverted else sunk)
    edges = [middle - slope * (column + 0.5 - width / 2.0) for column in range(width)]
    tone, over = (Tone.STALE, Tone.STALE) if is_stale else (Tone.GROUND, Tone.STRONG)
    rows: list[list[str]] = []
    for row in range(height):
        shares = [max(0.0, min(1.0, edge - row if is_inverted else row + 1.0 - edge)) for edge in edges]
        if is_inverted:  # blocks grow from below only: the ground above is drawn in whole cells
            rows.append(["█" if share >= 0.5 else " " for share in shares])
        else:
            rows.append([EIGHTHS[round(8.0 * share)] for share in shares])
    at = (width - len(VEHICLE)) // 2
    found: list[Line] = []
    for number, cells in enumerate(rows):
        if number == height // 2:
            left, right = "".join(cells[:at]), "".join(cells[at + len(VEHICLE) :])
            found.append((Span(left, tone), Span(VEHICLE, over), Span(right, tone)))
        else:
            found.append((Span("".join(cells), tone),))
    return found
