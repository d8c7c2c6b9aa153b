"""The widgets that show lines: a panel draws only those that have changed, and scrolls; a list has a cursor as well."""

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

from rich.segment import Segment
from rich.style import Style
from textual.binding import Binding, BindingType
from textual.geometry import Region, Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip

from gloc3.documents.characters import printable
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
        """Creates a panel.

        Args:
            id: its name in the style sheet.
            classes: `plain` for no rule above it.
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
            for y, (previous, new) in enumerate(zip(before, self._lines, strict=True))
            if previous != new and 0 <= y - top < self.size.height
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
            segments = [Segment(printable(span.text), self._full_style(span.tone, base)) for span in line]
            strip = Strip(segments).adjust_cell_length(self.size.width, base)
            if len(self._strips) > 4 * len(self._lines) + 100:
                self._strips.clear()
            self._strips[line] = strip
        return strip

    def notify_style_update(self) -> None:
        """Clears lines drawn in other colours."""
        self._clear_strips()
        super().notify_style_update()

    def on_resize(self) -> None:
        """Clears lines drawn at another width; stays at the end if it was there."""
        self._clear_strips()
        if self._follows_end:
            self.scroll_to(y=len(self._lines), animate=False, immediate=True, force=True)

    def _clear_strips(self) -> None:
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


class Row(NamedTuple):
    """A line of a list."""

    line: Line
    key: str = ""
    """Identifies the row; empty for a heading or a continuation line, on which the cursor never stops."""


class ListPanel(Panel):
    """Lines with a cursor; `Chosen` is posted on enter, `Moved` when the cursor has moved to another row."""

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
        """The cursor has moved to another row."""

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

    def shows(self, index: int) -> bool:
        """Whether the row of an index is, or may soon be, in sight; the line of another need not be made."""
        top, height = self.scroll_offset.y, max(1, self.size.height)
        return top - height <= index < top + 2 * height or index == self._index

    def point_at(self, key: str) -> None:
        """Moves the cursor to a row."""
        for index, row in enumerate(self._rows):
            if row.key == key:
                self._point(index)
                self._reveal()

    def action_move(self, rows: int) -> None:
        """Moves the cursor by `rows` rows."""
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
