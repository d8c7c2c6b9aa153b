"""The help of the current screen, generated from its text and its keys."""

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen, Screen

from gloc3_groundstation.tui.screen import ScreenRow, StationScreen
from gloc3_groundstation.tui.widgets.lines import EMPTY, Line, Span, Tone, wrapped
from gloc3_groundstation.tui.widgets.panel import Panel


class HelpKey(NamedTuple):
    """A key with its label and explanation."""

    key: str
    label: str
    help: str
    is_general: bool
    """Whether it works on every screen."""


class HelpScreen(ModalScreen[None]):
    """Shows help over the screen that it is about."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,question_mark,q", "dismiss", "Close")]

    def __init__(self, title: str, text: str, keys: list[HelpKey], screens: list[tuple[str, str, str]]) -> None:
        super().__init__()
        self._title, self._text, self._keys, self._screens = title, text, keys, screens

    def compose(self) -> ComposeResult:
        """One panel, which scrolls."""
        with Vertical(classes="sheet"):
            yield Panel(id="help")

    def on_mount(self) -> None:
        """Sets the title and the hint for closing in the border."""
        sheet = self.query_one(Vertical)
        sheet.border_title = f"{self._title}: help"
        sheet.border_subtitle = "esc closes"
        self.query_one(Panel).focus()

    def on_resize(self) -> None:
        """Wraps the lines again."""
        self.call_after_refresh(self._fill)

    def _fill(self) -> None:
        panel = self.query_one(Panel)
        panel.show(help_lines(self._text, self._keys, self._screens, max(20, panel.width - 1)))


def help_for(screen: StationScreen, rows: Sequence[ScreenRow]) -> HelpScreen:
    """The help of a screen, which must be the one in view."""
    screens = [(row.key, row.title, row.help) for row in rows]
    return HelpScreen(screen.row.title, screen.HELP, _keys(screen, screen.app), screens)


def _keys(screen: Screen[Any], app: App[Any]) -> list[HelpKey]:
    """Keys that work on a screen: the shown ones, and those with a tooltip; keys of one action are grouped."""
    found: dict[str, HelpKey] = {}
    for active in screen.active_bindings.values():
        binding = active.binding
        if binding.action in found or not (binding.show or binding.tooltip):
            continue
        key = app.get_key_display(binding)
        found[binding.action] = HelpKey(key, binding.description, binding.tooltip, active.node is app)
    return list(found.values())


def help_lines(text: str, keys: Sequence[HelpKey], screens: Sequence[tuple[str, str, str]], width: int) -> list[Line]:
    """Lines of the help.

    Args:
        text: explanation of the screen.
        keys: those that work now.
        screens: key, title and a line for each screen.
        width: columns.
    """
    lines: list[Line] = []
    for paragraph in text.strip().split("\n\n"):
        lines += [(Span(row),) for row in wrapped(" ".join(paragraph.split()), width)]
        lines.append(EMPTY)
    for heading, is_general in (("Keys of this screen", False), ("Keys that work everywhere", True)):
        listed = [key for key in keys if key.is_general is is_general]
        if listed:
            lines.append((Span(heading, Tone.STRONG),))
            for key in listed:
                said = f"{key.label}: {key.help}" if key.help else key.label
                lines += _entry(key.key, said, width)
            lines.append(EMPTY)
    lines.append((Span("Screens", Tone.STRONG),))
    for digit, title, said in screens:
        lines += _entry(digit, f"{title}: {said}", width)
    return lines


def _entry(key: str, text: str, width: int) -> list[Line]:
    rows = wrapped(text, width - 12)
    return [(Span(f"  {key if n == 0 else '':<10}", Tone.KEY), Span(row)) for n, row in enumerate(rows)]
