"""A panel for pictures: of a line that has changed, only the columns that differ are drawn again."""

from collections.abc import Sequence

from textual.events import MouseMove
from textual.geometry import Region
from textual.message import Message

from gloc3_groundstation.tui.widgets.lines import Line, changed_columns
from gloc3_groundstation.tui.widgets.panel import Panel


class CanvasPanel(Panel):
    """Lines that fill the panel and never scroll; `Pointed` reports the mouse position."""

    class Pointed(Message):
        """The mouse is over a cell."""

        def __init__(self, panel: "CanvasPanel", column: int, row: int) -> None:
            super().__init__()
            self.panel = panel
            self.column = column
            self.row = row

        @property
        def control(self) -> "CanvasPanel":
            """The panel, for `@on(CanvasPanel.Pointed, "#id")`."""
            return self.panel

    def show(self, lines: Sequence[Line], title: str | None = None) -> None:
        """Shows another picture."""
        before = self.lines
        if len(before) != len(lines):
            super().show(lines, title)
            return
        if title is not None and title != self.border_title:
            self.border_title = title
        regions = []
        for y, (previous, new) in enumerate(zip(before, lines, strict=True)):
            if previous != new:
                begin, end = changed_columns(previous, new)
                regions.append(Region(begin, y, end - begin, 1))
        self._lines = list(lines)
        if regions:
            self.refresh(*regions)

    def on_mouse_move(self, event: MouseMove) -> None:
        """Tells the screen."""
        offset = event.get_content_offset(self)
        if offset is not None:
            self.post_message(self.Pointed(self, offset.x, offset.y))
