"""Shows a picture in half blocks, two pixels a character; in shades of ink where the terminal has no colours."""

from typing import Final

from rich.color import Color
from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip

from gloc3_groundstation.station.pictures import GreyImage
from gloc3_groundstation.tui.widgets.panel import Panel

HALF: Final = "▀"
INK: Final = " ░▒▓█"
"""From dark to light, on a dark background."""
STEP: Final = 8
"""Distance of displayed grey values: fewer styles, fewer bytes to the terminal."""


class PicturePanel(Panel):
    """A panel that shows lines or a picture."""

    def __init__(self, *, id: str, classes: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id, classes=classes)
        self._picture: GreyImage | None = None
        self._rows: list[Strip] = []

    @property
    def room(self) -> tuple[int, int]:
        """Pixels across and down that can be shown."""
        region = self.scrollable_content_region
        return max(1, region.width), max(1, 2 * region.height)

    @property
    def picture(self) -> GreyImage | None:
        """What it shows."""
        return self._picture

    def show_picture(self, picture: GreyImage | None, title: str | None = None) -> None:
        """Shows a picture, or the lines again."""
        if title is not None and title != self.border_title:
            self.border_title = title
        if picture == self._picture:
            return
        self._picture = picture
        draw = self._inked if self.app.has_class("-mono") else self._grey
        self._rows = draw(picture) if picture is not None else []
        self.refresh()

    def render_line(self, y: int) -> Strip:
        """One line of the screen."""
        if self._picture is None:
            return super().render_line(y)
        if y >= len(self._rows):
            return Strip.blank(self.size.width, self.rich_style)
        return self._rows[y].adjust_cell_length(self.size.width, self.rich_style)

    def notify_style_update(self) -> None:
        """Draws again in other colours."""
        self._picture = None
        super().notify_style_update()

    @staticmethod
    def _grey(picture: GreyImage) -> list[Strip]:
        width, height, data = picture
        rows = []
        for top in range(0, height, 2):
            upper = data[top * width : (top + 1) * width]
            lower = data[(top + 1) * width : (top + 2) * width] or upper
            segments: list[Segment] = []
            start = 0
            for x in range(1, width + 1):
                is_same = x < width and (upper[x] // STEP, lower[x] // STEP) == (
                    upper[start] // STEP,
                    lower[start] // STEP,
                )
                if not is_same:
                    segments.append(Segment(HALF * (x - start), _style(upper[start] // STEP, lower[start] // STEP)))
                    start = x
            rows.append(Strip(segments, width))
        return rows

    @staticmethod
    def _inked(picture: GreyImage) -> list[Strip]:
        width, height, data = picture
        rows = []
        for top in range(0, height, 2):
            upper = data[top * width : (top + 1) * width]
            lower = data[(top + 1) * width : (top + 2) * width] or upper
            text = "".join(INK[(a + b) * len(INK) // 512] for a, b in zip(upper, lower, strict=True))
            rows.append(Strip([Segment(text)], width))
        return rows


def _style(upper: int, lower: int) -> Style:
    return Style(color=_color(upper), bgcolor=_color(lower))


def _color(step: int) -> Color:
    grey = min(255, step * STEP + STEP // 2)
    return Color.from_rgb(grey, grey, grey)
