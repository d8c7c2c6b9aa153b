"""Dialogue for saving or exporting a mission: the file name, and what that format cannot hold."""

from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input

from gloc3.errors import Refused
from gloc3_groundstation.missions.files import KINDS
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, wrapped
from gloc3_groundstation.tui.widgets.panel import Panel

Lost = Callable[[Path], tuple[str, ...]]
"""Tells what a file could not carry; raises `Refused` where it cannot be written at all."""
Objection = Callable[[Path], str]
"""Tells why a file should not be written without another word."""


Write = Callable[[Path], str]
"""Writes a file; returns why it could not, or nothing."""


class SaveMission(ModalScreen[bool]):
    """Writes a file, and closes with whether it did."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "dismiss(False)", "Close")]

    def __init__(self, suggested: Path, lost: Lost, objection: Objection, write: Write) -> None:
        """A dialogue.

        Args:
            suggested: the file to begin with.
            lost: what would be lost.
            objection: what speaks against it.
            write: writes it.
        """
        super().__init__()
        self._suggested = suggested
        self._lost = lost
        self._objection = objection
        self._write = write
        self._warned_of = ""

    def compose(self) -> ComposeResult:
        """The name, and what is to be said of it."""
        with Vertical(classes="sheet save"):
            yield Input(str(self._suggested), id="name", select_on_focus=False)
            yield Panel(id="said", classes="plain", can_focus=False)

    def on_mount(self) -> None:
        """Says what this is and how to leave it."""
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
        """Writes, unless something speaks against it and has not been read yet."""
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
        if path.suffix not in KINDS:
            return f"the file type follows the suffix: {', '.join(KINDS)}"
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
        lines: list[Line] = [(Span(f"written as: {KINDS[path.suffix]}", Tone.DIM),)]
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
