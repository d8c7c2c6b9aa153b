"""Dialogue about unsaved changes of a mission."""

from enum import StrEnum
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Static

from gloc3_groundstation.tui.dialogues.questions import choices


class Unsaved(StrEnum):
    """What to do with the changes."""

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
