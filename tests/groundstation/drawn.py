"""What a program sees in a terminal that is drawn: texts that do not fit their place, and how well colours stand apart."""

from collections.abc import Iterator
from itertools import combinations
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len
from rich.color_triplet import ColorTriplet
from rich.segment import Segment
from textual.app import App
from textual.color import Color
from textual.geometry import Region
from textual.widget import Widget
from textual.widgets import Static

from gloc3_groundstation.tui.themes import THEMES
from gloc3_groundstation.tui.widgets.lines import text_of
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel


def clipped(app: App[Any]) -> list[str]:
    """What of the screen, or of the dialogue over it, cannot be read where it is, in words; best empty."""
    screen = app.screen
    found: list[str] = []
    for widget in screen.query("*"):
        if not widget.display or not widget.region.size or any(not each.display for each in widget.ancestors[:-1]):
            continue
        found += [f"#{widget.id or type(widget).__name__}: {each}" for each in _problems(widget)]
    return found


def _problems(widget: Widget) -> Iterator[str]:
    geometry = widget.screen.find_widget(widget)
    is_scrolled = any(
        each.is_scrollable and each is not widget for each in widget.ancestors if isinstance(each, Widget)
    )
    if not is_scrolled and not geometry.clip.contains_region(geometry.region):
        yield f"{geometry.region} reaches out of {geometry.clip}"
    if isinstance(widget, Panel):
        yield from _of_panel(widget)
    elif isinstance(widget, Static) and not is_scrolled:
        width, height = widget.content_size
        needed = widget.get_content_height(widget.app.size, widget.app.size, width)
        if needed > height:
            yield f"{needed} lines of text in {height}"


def _of_panel(panel: Panel) -> Iterator[str]:
    width, height = panel.scrollable_content_region.size
    title = str(panel.border_title or "")
    if cell_len(title) > max(0, panel.size.width - 4):
        yield f"title {title!r} in {panel.size.width} columns"
    is_guided = isinstance(panel, ListPanel) and hasattr(panel.screen, "action_move")  # by the keys of its dialogue
    if not (panel.can_focus or is_guided) and len(panel.lines) > height:
        yield f"{len(panel.lines)} lines in {height}, which nobody can scroll"
    if panel.styles.overflow_x == "auto":
        return
    top = panel.scroll_offset.y
    for line in panel.lines[top : top + height]:
        if cell_len(text_of(line).rstrip()) > width:
            yield f"{text_of(line).rstrip()!r} in {width} columns"


XYZ: Final = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
SIGHTS: Final = {
    "full sight": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
}
"""What becomes of linear red, green and blue in the eyes of those who see red and green alike.

G. M. Machado, M. M. Oliveira, L. A. F. Fernandes: A physiologically-based model for simulation of color vision
deficiency, IEEE Transactions on Visualization and Computer Graphics 15 (6), 2009, severity 1.0.
"""
READABLE: Final = 4.5
"""The contrast that WCAG 2 asks for."""


class Contrast(NamedTuple):
    """A text, and how well it stands out from what is behind it."""

    ratio: float
    """As WCAG 2 defines it: 1 for the same colour, 21 for black on white; 4.5 is its bar for text."""
    text: str
    colours: str


def contrasts(app: App[Any]) -> list[Contrast]:
    """Each pair of colours that is in sight with a text, the worst first; none of a theme without colours."""
    own = _own_region(app)
    found: dict[str, Contrast] = {}
    for text, front, back in _texts(app, own):
        key = f"{front.hex} on {back.hex}"
        if key not in found:
            found[key] = Contrast(_ratio(front, back), text.strip(), key)
    return sorted(found.values())


def colours(app: App[Any]) -> set[str]:
    """The names of all colours that are used."""
    styles = [segment.style for strip in _strips(app) for segment in strip if segment.style is not None]
    return {colour.name for style in styles for colour in (style.color, style.bgcolor) if colour is not None}


def cut_texts(app: App[Any]) -> int:
    """How many texts end in an ellipsis, as there is no room for all of them."""
    return sum("…" in segment.text for strip in _strips(app) for segment in strip)


def apart(theme: str) -> dict[str, float]:
    """The least distance between the colours of good, busy, warning and error, for each kind of sight (CIE 1976, in L*a*b*).

    2.3 can just be told apart. Words and signs say the same as the colours.
    """
    chosen = next(each for each in THEMES if each.name == theme)
    tones = [Color.parse(str(each)).rgb for each in (chosen.success, chosen.primary, chosen.warning, chosen.error)]
    found = {}
    for sight, matrix in SIGHTS.items():
        seen = [_lab(matrix @ _linear(tone)) for tone in tones]
        found[sight] = min(float(np.linalg.norm(a - b)) for a, b in combinations(seen, 2))
    return found


def _linear(colour: tuple[int, int, int]) -> NDArray[np.float64]:
    """Linear red, green and blue, 0 to 1, of sRGB."""
    parts = np.array(colour) / 255.0
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def _lab(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """L*a*b* of linear sRGB in the light of D65 (IEC 61966-2-1, CIE 15)."""
    xyz = XYZ @ np.clip(linear, 0.0, 1.0) / np.array([0.95047, 1.0, 1.08883])
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


def _own_region(app: App[Any]) -> Region:
    """The dialogue, where one lies over the screen: what is below it is meant to be faint."""
    screen = app.screen
    return next(iter(screen.children)).region if screen.is_modal else screen.region


def _strips(app: App[Any]) -> list[list[Segment]]:
    return [list(strip) for strip in app.screen._compositor.render_strips()]


def _texts(app: App[Any], region: Region) -> Iterator[tuple[str, ColorTriplet, ColorTriplet]]:
    for y, strip in enumerate(_strips(app)):
        x = 0
        for segment in strip:
            style, begin = segment.style, x
            x += segment.cell_length
            if style is None or not any(letter.isalnum() for letter in segment.text) or not region.contains(begin, y):
                continue
            if style.color is None or style.bgcolor is None or style.color.is_default or style.bgcolor.is_default:
                continue
            front, back = style.color.get_truecolor(), style.bgcolor.get_truecolor()
            yield (segment.text, back, front) if style.reverse else (segment.text, front, back)


def _ratio(one: ColorTriplet, other: ColorTriplet) -> float:
    low, high = sorted((_luminance(one), _luminance(other)))
    return (high + 0.05) / (low + 0.05)


def _luminance(colour: ColorTriplet) -> float:
    """Relative luminance (WCAG 2.2, https://www.w3.org/TR/WCAG22/#dfn-relative-luminance)."""
    parts = [part / 255.0 for part in colour]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue
