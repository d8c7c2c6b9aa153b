"""Strip charts: values over time in braille, with a stable axis in round steps."""

from collections.abc import Sequence
from math import ceil, floor, log10
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3_groundstation.mapping.history import HistorySeries
from gloc3_groundstation.tui.widgets.canvas import CellCanvas, Dots
from gloc3_groundstation.tui.widgets.lines import Line, Span, Tone, column, cut, spread, text_of

Floating = NDArray[np.floating[Any]]

AXIS: Final = 8
"""Columns left of a chart, for the values at its edges."""
CALM_S: Final = 0.5
"""Shortest time between moves of a chart, s; each redraws it, and the terminal may be remote."""
HEADROOM: Final = 0.04
"""Of the axis, that the values leave free at both ends."""


class Curve(NamedTuple):
    """One series of a chart."""

    name: str
    series: HistorySeries
    tone: Tone
    is_dotted: bool = False


class Scale(NamedTuple):
    """The values at the lower and upper edge of a chart."""

    low: float
    high: float
    decimals: int


class ChartWindow(NamedTuple):
    """Time range of a chart, on the station's clock."""

    from_s: float
    to_s: float

    @property
    def length_s(self) -> float:
        """How long it is."""
        return self.to_s - self.from_s


def window_at(now_s: float, length_s: float, columns: int) -> ChartWindow:
    """The window that ends now, moved by whole columns so that the drawing stays the same in between.

    It ends slightly later than now: new values appear at its right edge, and it moves at most twice a second.
    """
    column_s = length_s / max(1, columns)
    step_s = column_s * ceil(CALM_S / column_s)
    to_s = ceil(now_s / step_s) * step_s
    return ChartWindow(to_s - length_s, to_s)


def scale_of(curves: Sequence[Curve], window: ChartWindow, least: float) -> Scale:
    """Edges in round steps, at least so far apart, around all values in the window."""
    lows, highs = [], []
    for curve in curves:
        is_in = (curve.series.times_s >= window.from_s) & (curve.series.times_s <= window.to_s)
        if is_in.any() and not np.isnan(curve.series.lows[is_in]).all():
            lows.append(float(np.nanmin(curve.series.lows[is_in])))
            highs.append(float(np.nanmax(curve.series.highs[is_in])))
    if not lows:
        return Scale(0.0, least, _decimals(least))
    return round_scale(min(lows), max(highs), least)


def round_scale(low: float, high: float, least: float) -> Scale:
    """Edges in round steps around two values, at least so far apart."""
    missing = max(0.0, least - (high - low) * (1.0 + 2.0 * HEADROOM)) / 2.0
    room = (high - low) * HEADROOM + missing
    step = _step((high - low + 2.0 * room) / 4.0)
    begin, end = floor((low - room) / step + 1e-9) * step, ceil((high + room) / step - 1e-9) * step
    if low > -room / 4.0:
        begin = max(0.0, begin)
    return Scale(begin + 0.0, end + 0.0, _decimals(step))


def chart_lines(
    title: Line, curves: Sequence[Curve], window: ChartWindow, scale: Scale, width: int, height: int, wrap: float = 0.0
) -> list[Line]:
    """A chart of the given height, the title being the first line.

    Args:
        title: the line above it.
        curves: the curves, the most important last.
        window: the time.
        scale: the values at the edges.
        width: columns, with the axis.
        height: lines, with the title.
        wrap: a step of more than half of this is a wrap-around, such as from 359 to 0 degrees, and not drawn.
    """
    canvas = CellCanvas(width - AXIS, height - 1)
    across, down = canvas.size
    span = scale.high - scale.low
    for curve in curves:
        series = curve.series
        if not len(series.times_s):
            continue
        x = (series.times_s - window.from_s) / window.length_s * across
        top = (scale.high - series.highs) / span * (down - 1)
        bottom = (scale.high - series.lows) / span * (down - 1)
        off = 3 if curve.is_dotted else 0
        points = _points(x, top, bottom)
        canvas.line(_parted(points, wrap / span * down) if wrap else points, curve.tone, on=1, off=off)
    return [title, *with_axis(canvas.lines(), scale, wrap)]


def with_axis(rows: Sequence[Line], scale: Scale, wrap: float = 0.0) -> list[Line]:
    """Rows of a chart with the values at its edges, and in the middle where there is room."""
    last = len(rows) - 1
    labels = {0: scale.high, last: scale.low}
    if last >= 4 and last % 2 == 0:
        labels[last // 2] = (scale.high + scale.low) / 2.0
    found = []
    for number, row in enumerate(rows):
        value = labels.get(number)
        text = "" if value is None else _label(value % wrap if wrap and value != wrap else value, scale.decimals)
        found.append(
            (Span(f"{cut(text, AXIS - 2):>{AXIS - 2}} ", Tone.DIM), Span("┤" if text else "│", Tone.DIM), *row)
        )
    return found


def chart_title(name: str, unit: str, values: Sequence[tuple[str, str, Tone]], width: int) -> Line:
    """`height m     2.01   wanted 2.00`: a chart's name and unit, and the newest values with their names."""
    spans: list[Span] = []
    for label, value, tone in values:
        spans += [Span(f"   {label} " if label else "   ", Tone.DIM), Span(value, tone)]
    head = (Span(column(name, AXIS - 1) + " ", Tone.STRONG), Span(unit, Tone.DIM))
    return spread(head, (*spans, Span(" ")), width)


def time_axis(window: ChartWindow, now_s: float, width: int) -> Line:
    """The times below a stack of charts: how long ago."""
    room = width - AXIS
    late_s = max(0.0, now_s - window.to_s)
    late_s = 0.0 if late_s < window.length_s * 0.02 else late_s
    begin, middle = f"-{duration(late_s + window.length_s)}", f"-{duration(late_s + window.length_s / 2.0)}"
    end = f"-{duration(late_s)}" if late_s else "now"
    left = begin + " " * max(1, room // 2 - len(begin) - len(middle) // 2) + middle
    return (Span(" " * AXIS), Span(left + " " * max(1, room - len(left) - len(end)) + end, Tone.DIM))


def duration(seconds: float) -> str:
    """`45 s`, `2.5 min`, `30 min`, `8 h`."""
    if seconds < 59.5:
        return f"{seconds:.0f} s"
    if seconds < 3570.0:
        minutes = seconds / 60.0
        return f"{minutes:.0f} min" if abs(minutes - round(minutes)) < 0.05 else f"{minutes:.1f} min"
    return f"{seconds / 3600.0:.3g} h"


def beside(left: Sequence[Line], right: Sequence[Line], width: int, gap: int) -> list[Line]:
    """Two blocks of lines side by side, the left one `width` columns wide."""
    found = []
    for number in range(max(len(left), len(right))):
        one = left[number] if number < len(left) else ()
        other = right[number] if number < len(right) else ()
        found.append((*one, Span(" " * (width - len(text_of(one)) + gap)), *other))
    return found


def _points(x: Floating, top: Floating, bottom: Floating) -> Dots:
    """The corners of the line through the ranges: each from its top to its bottom, or back."""
    if (top == bottom)[~np.isnan(top)].all():
        return np.column_stack((x, top))
    corners = np.empty((2 * len(x), 2))
    corners[0::2, 0] = corners[1::2, 0] = x
    corners[0::2, 1], corners[1::2, 1] = top, bottom
    return corners


def _parted(points: Dots, wrap: float) -> Dots:
    """With a gap where a value goes round."""
    jumps = np.flatnonzero(np.abs(np.diff(points[:, 1])) > wrap / 2.0) + 1
    return np.insert(points, jumps, np.nan, axis=0)


def _label(value: float, decimals: int) -> str:
    """A value on the axis, with one more decimal in the middle."""
    return f"{value:.{decimals if abs(round(value, decimals) - value) < 1e-9 else decimals + 1}f}"


def _step(at_least: float) -> float:
    """The shortest of 1, 2, 5, 10, 20, 50… that is no shorter."""
    decade = 10.0 ** floor(log10(at_least))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= at_least * (1.0 - 1e-9))


def _decimals(step: float) -> int:
    return max(0, -floor(log10(step) + 1e-9))
