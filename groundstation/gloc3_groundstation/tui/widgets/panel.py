"""The one widget that shows lines: it draws only those that have changed, and scrolls."""

from collections.abc import Sequence

from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region, Size
from textual.scroll_view import ScrollView
from textual.strip import Strip

from gloc3_groundstation.tui.widgets.lines import Line, Tone


class Panel(ScrollView, can_focus=True):
    """Lines of spans. The tones' colours are the app's component classes `tone--TONE`: found once, not for each panel."""

    def __init__(
        self,
        *,
        id: str,  # noqa: A002 - Textual's name
        classes: str | None = None,
        follows_end: bool = False,
        can_focus: bool = True,
    ) -> None:
        """A panel.

        Args:
            id: its name in the style sheet.
            classes: `plain` has no rule above it.
            follows_end: whether it stays at the last line until the operator scrolls up.
            can_focus: whether it takes part in scrolling by key.
        """
        super().__init__(id=id, classes=classes)
        self.can_focus = can_focus
        self._follows_end = follows_end
        self._lines: list[Line] = []
        self._strips: dict[Line, Strip] = {}
        self._styles: dict[Tone, Style] = {}
        self._full_styles: dict[Tone, Style] = {}
        self._base: Style | None = None

    @property
    def lines(self) -> Sequence[Line]:
        """What it shows."""
        return self._lines

    @property
    def width(self) -> int:
        """Columns that a line may have."""
        return self.scrollable_content_region.width

    def show(self, lines: Sequence[Line], title: str | None = None) -> None:
        """Shows other lines; those that are the same are not drawn again."""
        if title is not None and title != self.border_title:
            self.border_title = title
        before, self._lines = self._lines, list(lines)
        if len(before) != len(self._lines):
            was_at_end = self.scroll_offset.y >= len(before) - self.size.height
            self.virtual_size = Size(0, len(self._lines))
            if self._follows_end and was_at_end:
                self.scroll_to(y=len(self._lines), animate=False, immediate=True, force=True)
            self.refresh()
            return
        top, width = self.scroll_offset.y, self.size.width
        changed = [
            Region(0, y - top, width, 1)
            for y, (old, new) in enumerate(zip(before, self._lines, strict=True))
            if old != new and 0 <= y - top < self.size.height
        ]
        if changed:
            self.refresh(*changed)

    def render_line(self, y: int) -> Strip:
        """One line of the screen."""
        index = y + self.scroll_offset.y
        base = self._base
        if base is None:
            base = self._base = self.rich_style
        if index >= len(self._lines):
            return Strip.blank(self.size.width, base)
        line = self._lines[index]
        strip = self._strips.get(line)
        if strip is None:
            segments = [Segment(span.text, self._full_style(span.tone, base)) for span in line]
            strip = Strip(segments).adjust_cell_length(self.size.width, base)
            if len(self._strips) > 4 * len(self._lines) + 100:
                self._strips.clear()
            self._strips[line] = strip
        return strip

    def notify_style_update(self) -> None:
        """Forgets what was drawn in other colours."""
        self._forget()
        super().notify_style_update()

    def on_resize(self) -> None:
        """Forgets what was drawn at another width; stays at the end where it was there."""
        self._forget()
        if self._follows_end:
            self.scroll_to(y=len(self._lines), animate=False, immediate=True, force=True)

    def _forget(self) -> None:
        self._strips.clear()
        self._styles.clear()
        self._full_styles.clear()
        self._base = None
        self.refresh()

    def _full_style(self, tone: Tone, base: Style) -> Style:
        style = self._full_styles.get(tone)
        if style is None:
            style = self._full_styles[tone] = base + self._style(tone)
        return style

    def _style(self, tone: Tone) -> Style:
        style = self._styles.get(tone)
        if style is None:
            style = self._styles[tone] = self.app.get_component_styles(f"tone--{tone}").partial_rich_style
        return style
