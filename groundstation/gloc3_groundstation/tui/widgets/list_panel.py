"""A panel in which a line can be chosen: a cursor that stays with its row when other rows come and go."""

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

from rich.segment import Segment
from rich.style import Style
from textual.binding import Binding, BindingType
from textual.message import Message
from textual.strip import Strip

from gloc3_groundstation.tui.widgets.lines import Line
from gloc3_groundstation.tui.widgets.panel import Panel


class Row(NamedTuple):
    """A line of a list."""

    line: Line
    key: str = ""
    """What the row stands for; empty for a heading or a further line, on which the cursor never rests."""


class ListPanel(Panel):
    """Lines with a cursor; `Chosen` is posted on enter, `Moved` when the cursor has come to another row."""

    COMPONENT_CLASSES = {"list--cursor"}
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "move(-1)", "Choose", show=False, key_display="↑ ↓", tooltip="a row of the list"),
        Binding("down", "move(1)", "Down", show=False),
        Binding("pageup", "move(-10)", "Ten up", show=False),
        Binding("pagedown", "move(10)", "Ten down", show=False),
        Binding("home", "move(-1000000)", "First", show=False),
        Binding("end", "move(1000000)", "Last", show=False),
        Binding("enter", "choose", "Open", show=False, key_display="enter", tooltip="the row under the cursor"),
    ]

    class Moved(Message):
        """The cursor is on another row."""

        def __init__(self, panel: "ListPanel", key: str) -> None:
            super().__init__()
            self.panel = panel
            self.key = key

        @property
        def control(self) -> "ListPanel":
            """The list, for `@on(ListPanel.Moved, "#id")`."""
            return self.panel

    class Chosen(Moved):
        """Enter was pressed on a row."""

    def __init__(self, *, id: str, classes: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id, classes=classes)
        self._rows: list[Row] = []
        self._key = ""
        self._index = -1

    @property
    def chosen(self) -> str:
        """The key of the row under the cursor; empty where there is none."""
        return self._key

    def show_rows(self, rows: Sequence[Row], title: str | None = None) -> None:
        """Shows other rows; the cursor stays with its row, or goes to the nearest one."""
        self._rows = list(rows)
        keys = [row.key for row in self._rows]
        if self._key not in keys or not self._key:
            self._point(self._nearest(max(0, self._index)))
        else:
            self._point(keys.index(self._key))
        self.show([row.line for row in self._rows], title)

    def sees(self, index: int) -> bool:
        """Whether the row of an index is, or may soon be, in sight; the line of another need not be made."""
        top, height = self.scroll_offset.y, max(1, self.size.height)
        return top - height <= index < top + 2 * height or index == self._index

    def point_at(self, key: str) -> None:
        """Puts the cursor on a row."""
        for index, row in enumerate(self._rows):
            if row.key == key:
                self._point(index)
                self._reveal()

    def action_move(self, rows: int) -> None:
        """Moves the cursor by so many rows."""
        places = [index for index, row in enumerate(self._rows) if row.key]
        if not places:
            return
        now = places.index(self._index) if self._index in places else 0
        self._point(places[max(0, min(len(places) - 1, now + rows))])
        self._reveal()

    def action_choose(self) -> None:
        """Tells which row was chosen."""
        if self._key:
            self.post_message(self.Chosen(self, self._key))

    def render_line(self, y: int) -> Strip:
        """One line of the screen; that under the cursor is marked."""
        strip = super().render_line(y)
        if y + self.scroll_offset.y != self._index or not self._key:
            return strip
        cursor, plain = self.get_component_rich_style("list--cursor", partial=True), self.rich_style.bgcolor
        mark = Style(bgcolor=cursor.bgcolor, reverse=cursor.reverse)
        return Strip(
            [
                Segment(text, (style or Style.null()) + mark)
                if style is None or style.bgcolor == plain
                else Segment(text, style)
                for text, style, _ in strip
            ],
            strip.cell_length,
        )

    def _point(self, index: int) -> None:
        before, self._index = self._index, index
        key = self._rows[index].key if 0 <= index < len(self._rows) else ""
        if index != before:
            self.refresh()
        if key != self._key:
            self._key = key
            self.post_message(self.Moved(self, key))

    def _nearest(self, index: int) -> int:
        places = [place for place, row in enumerate(self._rows) if row.key]
        return min(places, key=lambda place: abs(place - index), default=-1)

    def _reveal(self) -> None:
        top, height = self.scroll_offset.y, self.size.height
        first = 0 if all(not row.key for row in self._rows[: self._index]) else self._index
        if first < top:
            self.scroll_to(y=first, animate=False, immediate=True, force=True)
        elif self._index >= top + height:
            self.scroll_to(y=self._index - height + 1, animate=False, immediate=True, force=True)
