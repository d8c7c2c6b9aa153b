"""The command palette: screens with their keys, commands to the vehicle in view, vehicles, themes."""

from collections.abc import Iterator
from functools import partial
from typing import Protocol, cast

from textual.command import DiscoveryHit, Hit, Hits, Provider

from gloc3_groundstation.desk.autopilot_desk import OFFERS
from gloc3_groundstation.desk.desk import Move
from gloc3_groundstation.tui.screen import Offer, PaletteCommand, ScreenRow, StationScreen
from gloc3_groundstation.tui.screens.table import SCREENS
from gloc3_groundstation.tui.themes import DESCRIPTIONS
from gloc3_groundstation.tui.view import StationView

MOVES = {
    Move.START: "Start the mission",
    Move.PAUSE: "Pause the mission",
    Move.RESUME: "Resume the mission",
    Move.ABORT: "Abort the mission",
    Move.STREAM: "Upload the open mission",
    Move.CONTROL: "Request control",
}


class Commanded(Protocol):
    """Interface of the terminal for the palette; `StationApp` implements it."""

    current_mode: str
    plugged: tuple[ScreenRow, ...]
    """Screens of plug-ins."""

    def view(self) -> StationView:
        """What is shown now."""

    def show_vehicle(self, name: str) -> None:
        """Brings a vehicle into view."""

    def action_go(self, name: str) -> None:
        """Opens a screen."""

    def action_move(self, name: str) -> None:
        """Asks the vehicle in view for something."""

    def action_act(self, name: str) -> None:
        """Commands the autopilot of the vehicle in view."""

    def action_emergency(self) -> None:
        """Has the vehicle in view hold."""

    def action_acknowledge(self, is_all: bool = False) -> None:
        """Takes note of an alert, or of all."""

    def action_corrections(self) -> None:
        """Asks where RTK corrections come from, and takes them from there."""

    def action_end_corrections(self) -> None:
        """Takes no RTK corrections any more."""

    def action_help(self) -> None:
        """Explains the screen in view."""

    def action_leave(self) -> None:
        """Closes the terminal."""

    async def show_vehicle_on_screen(self, name: str, offer: Offer) -> None:
        """Opens a screen and performs the action of one of its keys."""


class StationCommands(Provider):
    """Offers the actions that are possible now, and those of the other screens' keys, which are then opened."""

    async def discover(self) -> Hits:
        """What can be done now, in order."""
        for command in self._commands():
            yield DiscoveryHit(command.title, command.run, help=command.help)

    async def search(self, query: str) -> Hits:
        """What fits some letters."""
        matcher = self.matcher(query)
        for command in (*self._commands(), *self._elsewhere()):
            score = matcher.match(command.title)
            if score > 0:
                yield Hit(score, matcher.highlight(command.title), command.run, help=command.help)

    def _commands(self) -> Iterator[PaletteCommand]:
        app = cast("Commanded", self.app)
        view, screen = app.view(), self.screen
        platform = view.platform
        if isinstance(screen, StationScreen):
            yield from screen.commands()
            yield from self._keys(screen)
        if platform is not None:
            for move, title in MOVES.items():
                if move in view.moves:
                    yield PaletteCommand(f"{platform.name}: {title}", "", partial(app.action_move, move))
            for action in view.actions:
                offer = OFFERS[action]
                title = f"{platform.name}: {offer.title}"
                yield PaletteCommand(title, offer.values, partial(app.action_act, action))
            yield PaletteCommand(f"{platform.name}: HOLD (emergency)", "at once, without asking", app.action_emergency)
        if view.alerts.pending:
            yield PaletteCommand("Acknowledge all alerts", "", partial(app.action_acknowledge, True))
        for name in view.fleet.platforms:
            if platform is None or name != platform.name:
                yield PaletteCommand(f"Show {name}", "brings it into view", partial(app.show_vehicle, name))
        for row in (*SCREENS, *app.plugged):
            yield PaletteCommand(f"Screen: {row.title}", row.help, partial(app.action_go, row.name))
        for theme, text in DESCRIPTIONS.items():
            yield PaletteCommand(f"Theme: {theme}", text, partial(setattr, app, "theme", theme))
        yield PaletteCommand(
            "RTK corrections: start", "from a caster or a base, for all vehicles", app.action_corrections
        )
        if view.fleet.corrections is not None:
            yield PaletteCommand("RTK corrections: stop", view.fleet.corrections.source, app.action_end_corrections)
        yield PaletteCommand("Help", "the screen in view and its keys", app.action_help)
        yield PaletteCommand("Quit", "asks while this station controls an armed vehicle", app.action_leave)

    def _elsewhere(self) -> Iterator[PaletteCommand]:
        """What the keys of the screens do that are not shown."""
        app = cast("Commanded", self.app)
        for row in SCREENS:
            if row.name != app.current_mode:
                for offer in row.screen.offers(row.title):
                    yield PaletteCommand(offer.title, offer.help, partial(app.show_vehicle_on_screen, row.name, offer))

    def _keys(self, screen: StationScreen) -> Iterator[PaletteCommand]:
        """The screen's own keys, by their names."""
        for active in screen.active_bindings.values():
            own = active.node is screen and active.enabled and active.binding.description
            if own and not active.binding.action.startswith(("screen.", "app.")):
                title = f"{screen.row.title}: {active.binding.description}"
                run = partial(screen.run_action, active.binding.action)
                yield PaletteCommand(title, active.binding.tooltip, run)
