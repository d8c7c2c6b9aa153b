"""Dialogue for opening a mission: recent files, examples, and the files of a folder."""

from pathlib import Path
from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input

from gloc3_groundstation.missions.files import FileGroup, MissionEntry, listing, matching, start_entries
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, cut, spread
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel, Row


class _Typed(Input):
    """What is typed; backspace in an empty line goes up a folder."""

    def action_delete_left(self) -> None:
        """Deletes, or goes up."""
        if not self.value and isinstance(self.screen, OpenMission):
            self.screen.action_above()
        super().action_delete_left()


class OpenMission(ModalScreen[str | None]):
    """Closes with a file, or the name of an example."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "move(-1)", "Up", show=False),
        Binding("down", "move(1)", "Down", show=False),
        Binding("pageup", "move(-10)", "Page up", show=False),
        Binding("pagedown", "move(10)", "Page down", show=False),
        Binding("escape", "dismiss", "Close"),
    ]
    AUTO_FOCUS = "#typed"

    def __init__(self, recent: tuple[str, ...], folder: Path) -> None:
        """A dialogue.

        Args:
            recent: what was recent.
            folder: where it begins.
        """
        super().__init__()
        self._start = start_entries(recent)
        self._listing = listing(folder)
        self._entries: dict[str, MissionEntry] = {}

    def compose(self) -> ComposeResult:
        """What is typed, and the list."""
        with Vertical(classes="sheet"):
            yield _Typed(placeholder="type to filter, or a path", id="typed")
            yield ListPanel(id="files", classes="plain")
            yield Panel(id="said", classes="plain line", can_focus=False)

    def on_mount(self) -> None:
        """Says what this is and how to leave it."""
        sheet = self.query_one(Vertical)
        sheet.border_title = "open a mission"
        sheet.border_subtitle = "enter opens   ↑ ↓ choose   backspace: parent folder   esc cancels"
        self.query_one(ListPanel).can_focus = False

    def on_resize(self) -> None:
        """Wraps the lines again."""
        self.call_after_refresh(self._fill)

    @on(Input.Changed, "#typed")
    def typed(self) -> None:
        """Filters; a path is gone to as it is typed."""
        folder, _ = self._path()
        if folder is not None and str(folder) != self._listing.folder:
            self._listing = listing(folder)
        self._fill(is_new=True)

    @on(Input.Submitted, "#typed")
    def choose(self) -> None:
        """Opens what the cursor is on, or the path that was typed."""
        entry = self._entries.get(self.query_one(ListPanel).chosen)
        typed = Path(self._value()).expanduser()
        if entry is None and self._value():
            self.dismiss(str(typed))
        elif entry is not None and entry.is_folder:
            self._go(Path(entry.path))
        elif entry is not None:
            self.dismiss(entry.path)

    def action_move(self, rows: int) -> None:
        """Moves the cursor of the list."""
        self.query_one(ListPanel).action_move(rows)

    def action_above(self) -> None:
        """Lists the folder above."""
        self._go(Path(self._listing.folder).parent)

    def _go(self, folder: Path) -> None:
        self._listing = listing(folder.absolute())
        self.query_one(Input).value = ""
        self._fill(is_new=True)

    def _value(self) -> str:
        return self.query_one(Input).value.strip()

    def _path(self) -> tuple[Path | None, str]:
        """The folder of a path that is being typed, and what of it is a filter."""
        value = self._value()
        if "/" not in value:
            return None, value
        head, _, tail = value.rpartition("/")
        folder = Path(f"{head}/").expanduser()
        return (folder.absolute() if folder.is_dir() else None), tail

    def _fill(self, *, is_new: bool = False) -> None:
        files = self.query_one(ListPanel)
        folder, wanted = self._path()
        start = matching(self._start, wanted) if folder is None else ()
        entries = (*start, *matching(self._listing.entries, wanted))
        self._entries = {str(number): entry for number, entry in enumerate(entries)}
        rows: list[Row] = []
        group = None
        for key, entry in self._entries.items():
            if entry.group is not group:
                group = entry.group
                title = f"folder {self._listing.folder}" if group is FileGroup.FOLDER else str(group)
                rows += [Row(EMPTY)] if rows else []
                rows.append(Row((Span(cut(f" {title}", files.width), Tone.DIM),)))
            rows.append(Row(_line(entry, files.width), key))
        if not self._entries:
            rows = [Row((Span(" no match; enter opens it as a path", Tone.DIM),))]
        files.show_rows(rows)
        if is_new and self._entries:
            files.point_at("0")
        problem = f" {self._listing.folder}: {self._listing.problem}" if self._listing.problem else ""
        self.query_one("#said", Panel).show([(Span(problem, Tone.WARN),)])


def _line(entry: MissionEntry, width: int) -> Line:
    if entry.is_folder:
        name = "..  parent folder" if entry.name == ".." else f"{entry.name}/"
        return (Span("   "), Span(cut(name, width - 4), Tone.BUSY))
    where = str(Path(entry.path).parent) if entry.group is FileGroup.RECENT else ""
    size = f"  {max(1, round(entry.size / 1000))} kB" if entry.size else ""
    right = f"{entry.kind}{size} "
    left = Span(f"   {cut(entry.name, width - len(right) - 6)}")
    room = width - len(left.text) - len(right) - 6
    beside = Span(f"  {cut(where, room)}" if where and room > 12 else "", Tone.DIM)
    return spread((left, beside), (Span(right, Tone.DIM),), width)
