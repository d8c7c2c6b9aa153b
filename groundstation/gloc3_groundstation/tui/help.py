"""The help of the current screen, generated from its text and its keys."""

from collections.abc import Sequence
from typing import Any, ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen, Screen

from gloc3_groundstation.tui.screen import ScreenRow, StationScreen
from gloc3_groundstation.tui.views.help import HelpKey, help_lines
from gloc3_groundstation.tui.widgets.panel import Panel


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
        """Says in the border what this is, and how to close it."""
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
    """The keys that work on a screen: those shown, and those with a tooltip; several keys for one action are told once."""
    found: dict[str, HelpKey] = {}
    for active in screen.active_bindings.values():
        binding = active.binding
        if binding.action in found or not (binding.show or binding.tooltip):
            continue
        key = app.get_key_display(binding)
        found[binding.action] = HelpKey(key, binding.description, binding.tooltip, active.node is app)
    return list(found.values())
