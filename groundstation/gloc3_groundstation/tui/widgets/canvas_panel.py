"""A panel for pictures: of a line that has changed, only the columns that differ are drawn again."""

from collections.abc import Sequence

from textual.events import MouseDown, MouseEvent, MouseMove, MouseScrollDown, MouseScrollUp, MouseUp
from textual.geometry import Region
from textual.message import Message

from gloc3_groundstation.tui.widgets.lines import Line, changed_columns
from gloc3_groundstation.tui.widgets.panel import Panel


class CanvasPanel(Panel):
    """Lines that fill the panel and never scroll; messages report the mouse. A drag is followed beyond the panel's edge."""

    class _AtCell(Message):
        """The mouse is over a cell; while it is dragged, perhaps one beside the panel."""

        def __init__(self, panel: "CanvasPanel", column: int, row: int) -> None:
            super().__init__()
            self.panel = panel
            self.column = column
            self.row = row

        @property
        def control(self) -> "CanvasPanel":
            """The panel, for `@on(CanvasPanel.Pointed, "#id")`."""
            return self.panel

    class Pointed(_AtCell):
        """The mouse has moved, without a button."""

    class Pressed(_AtCell):
        """A button was pressed."""

    class Dragged(_AtCell):
        """The mouse has moved with the button down."""

    class Released(_AtCell):
        """The button was released."""

    class Wheeled(_AtCell):
        """The wheel was turned."""

        def __init__(self, panel: "CanvasPanel", column: int, row: int, steps: int) -> None:
            super().__init__(panel, column, row)
            self.steps = steps
            """1 away from the operator, -1 towards."""

    _is_held = False

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
        if self._is_held:
            self.post_message(self.Dragged(self, *self._cell(event)))
        elif event.get_content_offset(self) is not None:
            self.post_message(self.Pointed(self, *self._cell(event)))

    def on_mouse_down(self, event: MouseDown) -> None:
        """Follows the mouse until the button is released."""
        if event.button == 1 and event.get_content_offset(self) is not None:
            self._is_held = True
            self.capture_mouse()
            self.post_message(self.Pressed(self, *self._cell(event)))

    def on_mouse_up(self, event: MouseUp) -> None:
        """Lets the mouse go."""
        if self._is_held:
            self._is_held = False
            self.release_mouse()
            self.post_message(self.Released(self, *self._cell(event)))

    def on_mouse_scroll_up(self, event: MouseScrollUp) -> None:
        """Tells the screen."""
        event.stop()
        self.post_message(self.Wheeled(self, *self._cell(event), 1))

    def on_mouse_scroll_down(self, event: MouseScrollDown) -> None:
        """Tells the screen."""
        event.stop()
        self.post_message(self.Wheeled(self, *self._cell(event), -1))

    def _cell(self, event: MouseEvent) -> tuple[int, int]:
        place = event.get_content_offset_capture(self)
        return place.x, place.y
