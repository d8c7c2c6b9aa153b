"""Dialogues for commanding a component: choice of a command or function, and a function's arguments."""

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Final

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from gloc3.component.component import FunctionEntry
from gloc3.component.description import FieldLine, fields_of
from gloc3.errors import Refused
from gloc3_groundstation.tui.dialogues.questions import choices
from gloc3_groundstation.tui.widgets.lines import Span, Tone, cut
from gloc3_groundstation.tui.widgets.panel import ListPanel, Row

DOC_WIDTH: Final = 40
HARM_QUESTION: Final = "{} {}?\n{} is ARMED and requires it; {}."
FORCE_QUESTION: Final = "{} {}?\n{}\nIf forced, actions that need it fail, and the mission's on_failure policy applies."


class ComponentMenu(ModalScreen[str | None]):
    """The commands that a component's state allows, and its functions; the one that is chosen, or none."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "dismiss", "Leave")]

    def __init__(self, title: str, commands: Mapping[str, str], functions: Sequence[FunctionEntry]) -> None:
        super().__init__()
        self._title, self._commands, self._functions = title, commands, functions

    def compose(self) -> ComposeResult:
        """A list."""
        with Vertical(classes="question"):
            yield Static(self._title, markup=False)
            yield ListPanel(id="menu", classes="plain")
            yield choices(("enter", "do it"), ("esc", "cancel"))

    def on_mount(self) -> None:
        """Fills the list."""
        menu = self.query_one(ListPanel)
        rows = [
            Row((Span(f"{name:<16}", Tone.STRONG), Span(effect, Tone.DIM)), name)
            for name, effect in self._commands.items()
        ]
        for entry in self._functions:
            doc = entry.doc.strip().partition("\n")[0]
            name, reported = Span(f"{entry.name + '…':<16}", Tone.BUSY), Span(cut(doc, DOC_WIDTH), Tone.DIM)
            rows.append(Row((name, reported), entry.name))
        menu.styles.height = min(len(rows), 12)
        menu.show_rows(rows)
        menu.focus()

    @on(ListPanel.Chosen)
    def chosen(self, event: ListPanel.Chosen) -> None:
        """Closes with the choice."""
        self.dismiss(event.key)


class FunctionForm(ModalScreen[dict[str, str] | None]):
    """The arguments of a function: a line for each, with its type, bounds and default."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "leave", "Leave")]
    AUTO_FOCUS = "Input"

    def __init__(self, component: str, entry: FunctionEntry, check: Callable[[Mapping[str, str]], object]) -> None:
        """Creates a form.

        Args:
            component: owner of the function.
            entry: the function.
            check: raises `Refused` for invalid values.
        """
        super().__init__()
        self._component, self._entry, self._check = component, entry, check
        self._fields = fields_of(entry.request)

    def compose(self) -> ComposeResult:
        """A line for each argument."""
        with VerticalScroll(classes="question form"):
            doc = " ".join(self._entry.doc.strip().partition("\n\n")[0].split())
            yield Static(f"{self._component}: {self._entry.name}\n{doc}", markup=False)
            for field in self._fields:
                yield Static(_label(field), classes="label", markup=False)
                yield Input(id=f"argument_{field.name}", placeholder=_default(field), compact=True)
            yield Static("", id="form_error", classes="wrong", markup=False)
            yield choices(("enter", "send it"), ("tab", "next line"), ("esc", "cancel"))

    @on(Input.Submitted)
    def send(self) -> None:
        """Closes with the typed values, if they are valid."""
        texts = {field.name: self.query_one(f"#argument_{field.name}", Input).value for field in self._fields}
        try:
            self._check(texts)
        except Refused as reason:
            self.query_one("#form_error", Static).update(str(reason))
            return
        self.dismiss(texts)

    def action_leave(self) -> None:
        """Closes without sending."""
        self.dismiss(None)


def _label(field: FieldLine) -> str:
    bounds = f", {field.bounds}" if field.bounds else ""
    doc = f": {field.doc}" if field.doc else ""
    return f"{field.name} ({field.type}{bounds}){doc}"


def _default(field: FieldLine) -> str:
    if field.is_required:
        return "required"
    return "empty: unchanged" if field.default is None else f"{field.default}".lower()
