"""Confirmations of dangerous commands."""

from collections.abc import Sequence
from typing import Final

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from gloc3.messages.command_interface import EmergencyVerb
from gloc3_groundstation.services.actions import Action

ABORT_QUESTION: Final = "Abort the mission of {}?\nIts actions are cancelled; {}."
FAR_QUESTION: Final = "{}.\nUpload it all the same?"
LEAVE_QUESTION: Final = (
    "{} is armed and controlled by this station.\nWithout it, the mission's on_link_loss policy applies."
)
UNSAVED_QUESTION: Final = "{} has unsaved changes. They are kept in the station's state folder."


def start_question(mission: str, vehicles: Sequence[str]) -> str:
    """Asks before a start, with the names of all vehicles that it starts."""
    what = "It arms and starts moving" if len(vehicles) == 1 else "They arm and start moving"
    return f"Start {mission} on {', '.join(vehicles)}?\n{what}."


def choices(*keys: tuple[str, str], hint: str = "") -> Static:
    """Keys of a dialogue with their actions, one per line; an optional hint above them."""
    width = max(len(key) for key, _ in keys) + 2
    text = Content.styled(hint, "$quiet") if hint else Content()
    for key, what in keys:
        text += Content.assemble("\n" if text else "", (f"{key:<{width}}", "bold $primary"), what)
    return Static(text, classes="choices", markup=False)


class YesNoQuestion(ModalScreen[bool]):
    """Yes or no; anything but yes is no."""

    BINDINGS = [Binding("y", "answer(True)", "Yes"), Binding("n,escape", "answer(False)", "No")]

    def __init__(self, question: str, yes: str, no: str = "cancel") -> None:
        super().__init__()
        self._question = question
        self._yes, self._no = yes, no

    def compose(self) -> ComposeResult:
        """The question and the two keys."""
        with Vertical(classes="question"):
            yield Static(self._question, markup=False)
            yield choices(("y", self._yes), ("n", self._no))

    def action_answer(self, answer: bool) -> None:
        """Closes with the answer."""
        self.dismiss(answer)


class EmergencyQuestion(ModalScreen[tuple[EmergencyVerb, str] | Action | None]):
    """Asks for more than hold: land, or disarm after the platform's name has been typed.

    Args:
        platform: its name.
        returns: whether its autopilot is commanded, whose own return is another choice.
    """

    BINDINGS = [
        Binding("space", "choose('hold')", "Hold"),
        Binding("ctrl+@,ctrl+space", "choose('hold')", "Hold", show=False, priority=True),
        Binding("l", "choose('land')", "Land"),
        Binding("r", "come_home", "Return"),
        Binding("d", "type", "Disarm"),
        Binding("escape", "leave", "Leave"),
    ]

    def __init__(self, platform: str, *, returns: bool = False) -> None:
        super().__init__()
        self._platform, self._returns = platform, returns

    def compose(self) -> ComposeResult:
        """The choices."""
        home = [("r", "return home, by the autopilot itself")] if self._returns else []
        with Vertical(classes="question"):
            yield Static(f"Emergency: {self._platform}", markup=False)
            yield choices(
                ("space", "hold again"),
                ("l", "land here"),
                *home,
                ("d", "disarm: refused in flight" if self._returns else "DISARM: motors stop; in flight it crashes"),
                ("esc", "cancel"),
            )

    def action_choose(self, verb: str) -> None:
        """Closes with hold or land."""
        self.dismiss((EmergencyVerb(verb), ""))

    def action_come_home(self) -> None:
        """Closes with the autopilot's return, where there is that choice."""
        if self._returns:
            self.dismiss(Action.RETURN)

    def action_type(self) -> None:
        """Asks for the platform's name."""
        if not self.query(Input):
            self.query_one(Vertical).mount(Input(placeholder=f"type {self._platform} and press enter to disarm"))
            self.query_one(Vertical).call_after_refresh(lambda: self.query_one(Input).focus())

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Disarms if the name is right: only the autopilot itself, if that was what the choice said."""
        if event.value.strip() != self._platform:
            event.input.value = ""
        elif self._returns:
            self.dismiss(Action.DISARM)
        else:
            self.dismiss((EmergencyVerb.DISARM, self._platform))

    def action_leave(self) -> None:
        """Closes without doing anything."""
        self.dismiss(None)


class TextQuestion(ModalScreen[str | None]):
    """A line of text; none where it was left.

    Args:
        question: what is asked.
        value: the text to begin with.
        hint: examples.
        is_secret: whether the text is not shown.
    """

    BINDINGS = [Binding("escape", "leave", "Leave")]

    def __init__(self, question: str, value: str = "", hint: str = "", *, is_secret: bool = False) -> None:
        super().__init__()
        self._question, self._value, self._hint, self._is_secret = question, value, hint, is_secret

    def compose(self) -> ComposeResult:
        """The question and the line."""
        with Vertical(classes="question"):
            yield Static(self._question, markup=False)
            yield Input(self._value, password=self._is_secret)
            yield choices(("enter", "go on"), ("esc", "cancel"), hint=self._hint)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Closes with the typed text."""
        self.dismiss(event.value.strip() or None)

    def action_leave(self) -> None:
        """Closes without an answer."""
        self.dismiss(None)
