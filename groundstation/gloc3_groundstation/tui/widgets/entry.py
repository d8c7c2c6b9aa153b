"""Dialogue that asks for one line of text, shows what is known about it, and refuses invalid input."""

from collections.abc import Callable, Sequence

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from gloc3_groundstation.tui.widgets.lines import Line
from gloc3_groundstation.tui.widgets.panel import Panel


class TextEntry(ModalScreen[str | None]):
    """Closes with the text, or None."""

    BINDINGS = [Binding("escape", "leave", "Leave")]

    def __init__(
        self,
        title: str,
        lines: Callable[[int], Sequence[Line]] | None = None,
        *,
        value: str = "",
        hint: str = "",
        check: Callable[[str], str] = lambda _: "",
    ) -> None:
        """Creates the dialogue.

        Args:
            title: the requested value.
            lines: returns explanatory lines for a width in characters.
            value: the initial text.
            hint: shown while the field is empty.
            check: returns the error in a text; empty if it is valid.
        """
        super().__init__()
        self._title, self._lines, self._value, self._hint, self._check = title, lines, value, hint, check

    def compose(self) -> ComposeResult:
        """Title, explanatory lines, the input, and its error."""
        with Vertical(classes="entry"):
            if self._lines is not None:
                yield Panel(id="entry_lines", can_focus=False)
            yield Input(self._value, placeholder=self._hint, select_on_focus=True)
            yield Static("", id="entry_wrong", markup=False)

    def on_mount(self) -> None:
        """Sets the title and the hint for leaving in the border."""
        sheet = self.query_one(Vertical)
        sheet.border_title = self._title
        sheet.border_subtitle = "enter confirms, esc cancels"
        self.query_one(Input).focus()

    def on_resize(self) -> None:
        """Wraps the lines again."""
        self.call_after_refresh(self._fill)

    def on_input_changed(self, event: Input.Changed) -> None:
        """Clears the error of the previous text."""
        del event
        self.query_one("#entry_wrong", Static).update("")

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Closes, unless something is wrong."""
        wrong = self._check(event.value)
        if wrong:
            self.query_one("#entry_wrong", Static).update(wrong)
        else:
            self.dismiss(event.value)

    def action_leave(self) -> None:
        """Closes without a text."""
        self.dismiss(None)

    def _fill(self) -> None:
        if self._lines is not None:
            panel = self.query_one(Panel)
            lines = list(self._lines(max(20, panel.width)))
            panel.styles.height = min(len(lines), max(3, self.app.size.height - 9))
            panel.show(lines)
