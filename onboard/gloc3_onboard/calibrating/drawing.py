"""Drawings of a calibration: coverage in the terminal, and panels of an SVG with residuals, coverage and series."""

from collections.abc import Sequence
from html import escape
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gloc3_onboard.algorithms.calibration.coverage import CELLS, BoardCoverage

Floats = NDArray[np.float64]

SHADES: Final = "·░▒▓█"
FULL: Final = 24
"""Corners in a part of the picture that is shown full."""
PANEL_W, PANEL_H, EDGE = 340.0, 260.0, 40.0
COLOURS: Final = ("#2166ac", "#b2182b", "#1b7837", "#762a83")
MOST_DOTS: Final = 3000


def coverage_lines(coverage: BoardCoverage) -> list[str]:
    """The picture's parts and how often each has shown a corner, with tilts and distances beside."""
    down, right = coverage.spreads_deg
    distances = coverage.distances_m or [0.0]
    beside = [
        f"pictures  {len(coverage.tilts_deg)}",
        f"covered   {coverage.share:.0%} of the picture",
        f"tilts     {down:.0f} degrees up and down",
        f"          {right:.0f} degrees left and right",
        f"distances {min(distances):.2f} to {max(distances):.2f} m",
        "",
    ]
    rows = [
        "".join(2 * SHADES[min(4, -(-4 * int(count) // FULL))] for count in coverage.counts[row])
        for row in range(CELLS[1])
    ]
    return [f"  {row}   {text}".rstrip() for row, text in zip(rows, beside, strict=True)]


class PanelSeries(NamedTuple):
    """Points of a panel."""

    name: str
    x: Floats
    y: Floats
    is_line: bool = False


class DiagramPanel(NamedTuple):
    """A diagram."""

    title: str
    x_label: str
    y_label: str
    series: Sequence[PanelSeries]
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    """Ranges of the axes; as the data have them if None. The first may be the larger."""


def svg(title: str, panels: Sequence[DiagramPanel], columns: int = 3) -> str:
    """Panels side by side."""
    rows = -(-len(panels) // columns)
    width, height = min(columns, len(panels)) * PANEL_W, rows * PANEL_H + 30.0
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" font-family="sans-serif" font-size="11">',
        f'<rect width="{width:g}" height="{height:g}" fill="white"/>',
        f'<text x="12" y="20" font-size="14">{escape(title)}</text>',
    ]
    for number, panel in enumerate(panels):
        row, column = divmod(number, columns)
        parts.append(f'<g transform="translate({column * PANEL_W:g} {30.0 + row * PANEL_H:g})">')
        parts += [*_panel(panel), "</g>"]
    return "\n".join([*parts, "</svg>", ""])


def _panel(panel: DiagramPanel) -> list[str]:
    across = panel.x_range or _range([series.x for series in panel.series])
    up = panel.y_range or _range([series.y for series in panel.series])
    inner_w, inner_h = PANEL_W - 1.5 * EDGE, PANEL_H - 1.8 * EDGE
    left, top = EDGE, 0.8 * EDGE

    def place(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        return (
            left + inner_w * (x - across[0]) / (across[1] - across[0]),
            top + inner_h * (1.0 - (y - up[0]) / (up[1] - up[0])),
        )

    parts = [
        f'<rect x="{left:g}" y="{top:g}" width="{inner_w:g}" height="{inner_h:g}" fill="none" stroke="#999"/>',
        f'<text x="{left:g}" y="{top - 8:g}" font-weight="bold">{escape(panel.title)}</text>',
        f'<text x="{left:g}" y="{top + inner_h + 14:g}">{across[0]:.4g}</text>',
        f'<text x="{left + inner_w:g}" y="{top + inner_h + 14:g}" text-anchor="end">{across[1]:.4g}</text>',
        f'<text x="{left + inner_w / 2:g}" y="{top + inner_h + 28:g}" text-anchor="middle">{escape(panel.x_label)}</text>',
        f'<text x="{left - 3:g}" y="{top + inner_h:g}" text-anchor="end">{up[0]:.3g}</text>',
        f'<text x="{left - 3:g}" y="{top + 10:g}" text-anchor="end">{up[1]:.3g}</text>',
        f'<text transform="translate({left - 22:g} {top + inner_h / 2:g}) rotate(-90)" text-anchor="middle">{escape(panel.y_label)}</text>',
    ]
    for number, series in enumerate(panel.series):
        colour = COLOURS[number % len(COLOURS)]
        step = max(1, -(-len(series.x) // MOST_DOTS))
        x, y = place(series.x[::step], series.y[::step])
        points = [f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True)]
        if series.is_line and points:
            parts.append(f'<path d="M{" L".join(points)}" fill="none" stroke="{colour}"/>')
        else:
            dots = "".join(f"M{point}h0" for point in points)
            parts.append(
                f'<path d="{dots}" stroke="{colour}" stroke-width="2.5" stroke-linecap="round" opacity="0.6"/>'
            )
        if series.name:
            at = top + 14 * (number + 1)
            parts.append(f'<text x="{left + 5:g}" y="{at:g}" fill="{colour}">{escape(series.name)}</text>')
    return parts


def _range(values: Sequence[Floats]) -> tuple[float, float]:
    whole = np.concatenate([np.asarray(each, float).ravel() for each in values]) if values else np.zeros(1)
    whole = whole[np.isfinite(whole)]
    if not whole.size:
        return 0.0, 1.0
    low, high = float(whole.min()), float(whole.max())
    gap = 0.05 * (high - low) or 1.0
    return low - gap, high + gap
