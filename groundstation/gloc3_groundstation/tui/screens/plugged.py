"""A screen of an installed package: the lines that it gives."""

from collections.abc import Callable, Sequence
from typing import Final

from textual.app import ComposeResult

from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.tui.keys import MISSION_KEYS
from gloc3_groundstation.tui.screen import ScreenRow, StationScreen
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.widgets.lines import Line, Span
from gloc3_groundstation.tui.widgets.panel import Panel

PREFIX: Final = "plug-in "
"""Beginning of the names of such screens."""


class PluggedScreen(StationScreen):
    """The lines of a plug-in."""

    HELP = """A screen of an installed package. ^p lists all of them."""
    BINDINGS = MISSION_KEYS
    AUTO_FOCUS = "#plugged"

    def __init__(
        self, desk: Desk, rows: Sequence[ScreenRow], row: ScreenRow, moment: Callable[[], StationView]
    ) -> None:
        super().__init__(desk, rows, row, moment)
        self._plug_in = row.name.removeprefix(PREFIX)
        self.HELP = row.help  # type: ignore[misc] # the base's text is of the class

    def body(self) -> ComposeResult:
        """One panel."""
        yield Panel(id="plugged")

    def show_view(self, view: StationView) -> None:
        """Fills it."""
        texts = self.desk.plug_ins.screen_lines(self._plug_in, view.fleet, view.platform, view.now_s)
        lines: list[Line] = [(Span(f" {text}"),) for text in texts]
        self.panel("plugged").show(lines, self.row.title)


def plugged_rows(desk: Desk) -> tuple[ScreenRow, ...]:
    """The screens of the plug-ins that are installed."""
    screens = desk.plug_ins.screens.items()
    return tuple(ScreenRow(PREFIX + name, "", one.title, one.help, PluggedScreen) for name, one in screens)
