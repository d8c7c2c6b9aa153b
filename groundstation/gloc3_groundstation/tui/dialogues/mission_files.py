"""Dialogues for opening and saving a mission: unsaved changes are never lost silently."""

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Any, ClassVar, Final

from textual import on
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from gloc3.errors import Refused
from gloc3_groundstation.desk.mission_desk import MissionDesk
from gloc3_groundstation.missions.draft import Draft, objection
from gloc3_groundstation.missions.files import FileGroup, MissionEntry, kinds, listing, matching, start_entries
from gloc3_groundstation.tui.dialogues.questions import choices
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, cut, spread, wrapped
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel, Row

Then = Callable[[], None]
Lost = Callable[[Path], tuple[str, ...]]
"""Returns the parts that a file cannot express; raises `Refused` where it cannot be written at all."""
Objection = Callable[[Path], str]
"""Tells why a file should not be written without another word."""


Write = Callable[[Path], str]
"""Writes a file; returns why it could not, or nothing."""


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
        """Creates the dialogue.

        Args:
            recent: recently opened files.
            folder: initial folder.
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
        """Sets the title and the hint for leaving."""
        sheet = self.query_one(Vertical)
        sheet.border_title = "open a mission"
        sheet.border_subtitle = "enter opens   ↑ ↓ choose   backspace: parent folder   esc cancels"
        self.query_one(ListPanel).can_focus = False

    def on_resize(self) -> None:
        """Wraps the lines again."""
        self.call_after_refresh(self._fill)

    @on(Input.Changed, "#typed")
    def typed(self) -> None:
        """Filters; a typed path is followed."""
        folder, _ = self._path()
        if folder is not None and str(folder) != self._listing.folder:
            self._listing = listing(folder)
        self._fill(is_new=True)

    @on(Input.Submitted, "#typed")
    def choose(self) -> None:
        """Opens the entry under the cursor, or the typed path."""
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


class SaveMission(ModalScreen[bool]):
    """Writes a file, and closes with whether it was written."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "dismiss(False)", "Close")]

    def __init__(self, suggested: Path, lost: Lost, objection: Objection, write: Write) -> None:
        """Creates the dialogue.

        Args:
            suggested: the suggested file.
            lost: returns the parts that would be lost.
            objection: returns a reason against writing, such as an existing file.
            write: writes it.
        """
        super().__init__()
        self._suggested = suggested
        self._lost = lost
        self._objection = objection
        self._write = write
        self._warned_of = ""

    def compose(self) -> ComposeResult:
        """Field for the name, and remarks about it."""
        with Vertical(classes="sheet save"):
            yield Input(str(self._suggested), id="name", select_on_focus=False)
            yield Panel(id="said", classes="plain", can_focus=False)

    def on_mount(self) -> None:
        """Sets the title and the hint for leaving."""
        sheet = self.query_one(Vertical)
        sheet.border_title = "save the mission, or export it"
        sheet.border_subtitle = "enter writes   esc cancels"

    def on_resize(self) -> None:
        """Wraps the lines again."""
        self.call_after_refresh(self._show_result)

    @on(Input.Changed, "#name")
    def typed(self) -> None:
        """Tells of another file."""
        self._warned_of = ""
        self._show_result()

    @on(Input.Submitted, "#name")
    def write(self) -> None:
        """Writes, unless there is an objection that has not been shown yet."""
        path = self._path()
        if path is None or self._refusal(path):
            return
        if self._objection(path) and self._warned_of != str(path):
            self._warned_of = str(path)
            self._show_result()
            return
        problem = self._write(path)
        if problem:
            text = self.query_one("#said", Panel)
            text.show(_text(f"Not written: {problem}", Tone.BAD, text.width))
        else:
            self.dismiss(True)

    def _path(self) -> Path | None:
        value = self.query_one(Input).value.strip()
        return Path(value).expanduser() if value else None

    def _refusal(self, path: Path) -> str:
        known = kinds(is_written=True)
        if path.suffix not in known:
            return f"the file type follows the suffix: {', '.join(known)}"
        if path.is_dir() or not path.absolute().parent.is_dir():
            return f"{path} is a folder" if path.is_dir() else f"there is no folder {path.absolute().parent}"
        try:
            self._lost(path)
        except Refused as refusal:
            return str(refusal)
        return ""

    def _show_result(self) -> None:
        text = self.query_one("#said", Panel)
        path = self._path()
        if path is None:
            text.show([(Span("a file name is required", Tone.DIM),)])
            return
        refusal = self._refusal(path)
        if refusal:
            text.show(_text(refusal, Tone.BAD, text.width))
            return
        lines: list[Line] = [(Span(f"written as: {kinds()[path.suffix]}", Tone.DIM),)]
        lost = self._lost(path)
        if lost:
            lines += [EMPTY, (Span("This file type cannot hold everything:", Tone.WARN),)]
            for one in lost:
                lines += _text(f"- {one}", Tone.TEXT, text.width)
        objection = self._objection(path)
        if objection:
            again = ": enter again overwrites it" if self._warned_of == str(path) else ""
            lines += [EMPTY, *_text(f"{objection}{again}", Tone.WARN, text.width)]
        text.show(lines)


def _text(text: str, tone: Tone, width: int) -> list[Line]:
    return [(Span(row, tone),) for row in wrapped(text, max(20, width))]


class Unsaved(StrEnum):
    """Answers about unsaved changes."""

    SAVE = "save"
    DISCARD = "discard"
    STAY = "stay"


class UnsavedQuestion(ModalScreen[Unsaved]):
    """Save, discard or stay; anything but a clear word is stay."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("s", "answer('save')", "Save"),
        Binding("d", "answer('discard')", "Discard"),
        Binding("escape,n", "answer('stay')", "Stay"),
    ]

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name_of_mission = name

    def compose(self) -> ComposeResult:
        """The question and the keys."""
        with Vertical(classes="question"):
            yield Static(f"{self._name_of_mission} has unsaved changes.", markup=False)
            yield choices(("s", "save them first"), ("d", "discard them"), ("esc", "stay here"))

    def action_answer(self, answer: str) -> None:
        """Closes with the answer."""
        self.dismiss(Unsaved(answer))


def _nothing() -> None:
    """What follows where nothing does."""


class MissionFileDialogue:
    """Asks the operator, and has the desk do it."""

    def __init__(self, app: App[Any], missions: MissionDesk, vehicle: Callable[[], str | None]) -> None:
        """Creates the sequence of dialogues.

        Args:
            app: shows them.
            missions: reads and writes missions.
            vehicle: returns the name of the selected vehicle.
        """
        self._app: Final = app
        self._missions: Final = missions
        self._vehicle: Final = vehicle

    def choose(self, then: Callable[[str], None]) -> None:
        """Opens a dialogue to choose a file; asks about unsaved changes first."""

        def request() -> None:
            draft = self._missions.draft
            last = (draft.path or draft.made_of) if draft is not None else ""
            folder = Path(last).parent if last else Path.cwd()
            dialogue = OpenMission(self._missions.recent, folder.absolute())
            self._app.push_screen(dialogue, lambda file: then(file) if file is not None else None)

        self.when_saved(request)

    def when_saved(self, then: Then) -> None:
        """Continues once there are no unsaved changes."""
        draft = self._missions.draft
        if draft is None or not draft.is_changed:
            then()
            return

        def answered(answer: Unsaved | None) -> None:
            if answer is Unsaved.SAVE:
                self.save(then)
            elif answer is Unsaved.DISCARD:
                then()

        self._app.push_screen(UnsavedQuestion(draft.name), answered)

    def save(self, then: Then = _nothing) -> None:
        """Saves in the mission's own file; asks for a name if it has none, or if that file has changed since."""
        draft = self._missions.draft
        if draft is None or draft.is_fixed:
            return
        if not draft.path or objection(draft, Path(draft.path)):
            self.save_as(then)
        elif not self._missions.save(Path(draft.path), self._vehicle()):
            then()
        else:
            self.save_as(then)

    def save_as(self, then: Then = _nothing) -> None:
        """Saves under another name, or exports."""
        draft, missions = self._missions.draft, self._missions
        if draft is None or draft.is_fixed:
            return

        def write(path: Path) -> str:
            return missions.save(path, self._vehicle())

        dialogue = SaveMission(
            suggestion(draft),
            lambda path: missions.lost_in(path, self._vehicle()),
            lambda path: objection(draft, path),
            write,
        )
        self._app.push_screen(dialogue, lambda is_written: then() if is_written else None)


def suggestion(draft: Draft) -> Path:
    """The file that a mission would be saved in."""
    if draft.path:
        return Path(draft.path)
    if draft.made_of:
        return Path(draft.made_of).with_suffix(".yaml")
    return Path(Path(draft.name).stem.replace(" ", "_") + ".yaml")
