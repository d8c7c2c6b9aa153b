"""The text of a mission beside its findings; the cursor goes from finding to finding."""

import re
from collections.abc import Mapping
from typing import Final

from rich.segment import Segment
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Container
from textual.events import Key
from textual.strip import Strip
from textual.widgets import TextArea

from gloc3_groundstation.missions.draft import Draft
from gloc3_groundstation.tui.views.findings import finding_rows, findings_title
from gloc3_groundstation.tui.widgets.panel import ListPanel, Row

KEY: Final = re.compile(r"^(\s*(?:- )?)([\w-]+)(:)(?=\s|$)|([{,]\s*)([\w-]+)(:)(?=\s)")
COMMENT: Final = re.compile(r"(?:^|\s)#.*$")
ERROR, WARNING = "✗", "▲"


class MissionEditor(TextArea):
    """A text area for YAML; `marks` are shown beside the numbers of the lines."""

    COMPONENT_CLASSES = {"editor--key", "editor--comment", "editor--error", "editor--warning"}

    def __init__(self, *, id: str) -> None:  # noqa: A002 - Textual's name
        super().__init__(
            id=id, soft_wrap=False, show_line_numbers=True, tab_behavior="indent", highlight_cursor_line=True
        )
        self.indent_width = 2
        self._marks: Mapping[int, str] = {}

    def mark(self, marks: Mapping[int, str]) -> None:
        """Marks lines, counted from 0, with `ERROR` or `WARNING`."""
        if marks != self._marks:
            self._marks = dict(marks)
            self._line_cache.clear()
            self.refresh()

    def point_at(self, line: int, column: int) -> None:
        """Moves the cursor to a position, both numbers counted from 1; 0 for the start."""
        row = max(0, min(line - 1, self.document.line_count - 1))
        place = max(0, min(column - 1, len(self.document.get_line(row))))
        self.move_cursor((row, place))
        if not self.scroll_offset.y <= row < self.scroll_offset.y + self.size.height - 1:
            self.scroll_to(y=row - self.size.height // 2, animate=False, immediate=True)

    def get_line(self, line_index: int) -> Text:
        """A line with the colours of its keys and comment."""
        text = super().get_line(line_index)
        plain = text.plain
        if len(plain) > 400:
            return text
        comment = COMMENT.search(plain)
        end = comment.start() if comment else len(plain)
        key_style = self.get_component_rich_style("editor--key", partial=True)
        for found in KEY.finditer(plain, 0, end):
            group = 2 if found[2] else 5
            text.stylize(key_style, found.start(group), found.end(group) + 1)
        if comment:
            text.stylize(self.get_component_rich_style("editor--comment", partial=True), comment.start())
        return text

    def render_line(self, y: int) -> Strip:
        """A line of the screen, with its mark."""
        strip = super().render_line(y)
        mark = self._marks.get(y + self.scroll_offset.y)
        segments = list(strip)
        if mark is None or not segments or not segments[0].text.endswith("  "):
            return strip
        number, style = segments[0].text, segments[0].style
        name = "editor--error" if mark == ERROR else "editor--warning"
        marked = self.get_component_rich_style(name, partial=True)
        first = Segment(f"{number[:-2]}{mark} ", style + marked if style is not None else marked)
        return Strip([first, *segments[1:]], strip.cell_length)

    async def _on_key(self, event: Key) -> None:
        """Handles a new line's indentation, and leaves escape to the screen; all other keys go to the text area."""
        if event.key == "escape":
            event.prevent_default()
        elif event.key == "enter" and not self.read_only:
            event.stop()
            event.prevent_default()
            row, column = self.cursor_location
            before = self.document.get_line(row)[:column]
            indent = len(before) - len(before.lstrip(" "))
            deeper = 2 if before.rstrip().endswith(":") else 0
            start, end = self.selection
            self.replace("\n" + " " * (indent + deeper), start, end, maintain_selection_offset=False)


class MissionText(Container):
    """Editor and findings; side by side where there is room."""

    def __init__(self, *, id: str) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._draft: Draft | None = None
        self._is_filled = False

    def compose(self) -> ComposeResult:
        """The editor, and the findings."""
        yield MissionEditor(id="editor")
        yield ListPanel(id="findings")

    @property
    def editor(self) -> MissionEditor:
        """Where the text is edited."""
        return self.query_one(MissionEditor)

    def invalidate(self) -> None:
        """Reloads the text at the next update."""
        self._is_filled = False

    def show_mission(self, draft: Draft, *, is_checking: bool, is_wide: bool) -> None:
        """Shows a mission; its text is put into the editor once."""
        self._draft = draft
        editor, findings = self.editor, self.query_one("#findings", ListPanel)
        editor.read_only = draft.is_fixed
        if not self._is_filled:
            self._is_filled = True
            editor.load_text(draft.text)
        marks: dict[int, str] = {}
        for finding in draft.requested:
            if finding.line and marks.get(finding.line - 1) != ERROR:
                marks[finding.line - 1] = WARNING if finding.is_warning else ERROR
        editor.mark(marks)
        rows = [
            Row(row.line, str(row.number) if row.number >= 0 else "") for row in finding_rows(draft, findings.width - 1)
        ]
        findings.show_rows(rows, findings_title(draft, is_checking=is_checking))
        findings.styles.height = None if is_wide else max(3, min(len(rows) + 1, self.size.height // 3))

    def point_at(self, number: int) -> None:
        """Moves both cursors to a finding."""
        if self._draft is not None and number < len(self._draft.requested):
            finding = self._draft.requested[number]
            self.editor.point_at(finding.line, finding.column)
            self.query_one("#findings", ListPanel).point_at(str(number))

    def go_on(self, step: int) -> None:
        """Goes to the next finding (1), or the one before (-1), from where the editor's cursor is."""
        if self._draft is None or not self._draft.requested:
            return
        row, column = self.editor.cursor_location
        here = (row + 1, column + 1)
        places = [(finding.line, finding.column) for finding in self._draft.requested]
        numbers = sorted(range(len(places)), key=lambda number: places[number])
        if step > 0:
            self.point_at(next((n for n in numbers if places[n] > here), numbers[0]))
        else:
            self.point_at(next((n for n in reversed(numbers) if places[n] < here), numbers[-1]))

    @on(ListPanel.Chosen, "#findings")
    def jump(self, event: ListPanel.Chosen) -> None:
        """Goes to the place of the finding under the cursor."""
        self.point_at(int(event.key))
        self.editor.focus()
