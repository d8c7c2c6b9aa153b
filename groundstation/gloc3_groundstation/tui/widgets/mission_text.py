"""The text of a mission beside its findings; the cursor goes from finding to finding."""

from textual import on
from textual.app import ComposeResult
from textual.containers import Container

from gloc3_groundstation.missions.draft import Draft
from gloc3_groundstation.tui.views.findings import finding_rows, findings_title
from gloc3_groundstation.tui.widgets.mission_editor import ERROR, WARNING, MissionEditor
from gloc3_groundstation.tui.widgets.panel import ListPanel, Row


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
        """The next look brings another text."""
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
        """Puts both cursors on a finding."""
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
