"""Base class of all screens: title, tabs and alert above, keys below, and the screen's body between them."""

from collections.abc import Awaitable, Callable, Iterable, Iterator, Sequence
from typing import Any, ClassVar, Final, NamedTuple

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container
from textual.events import Click, Resize, ScreenResume
from textual.message import Message
from textual.screen import Screen

from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.tui.dialogues.questions import YesNoQuestion
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.chrome import (
    Key,
    Tab,
    alert_line,
    key_at,
    keys_line,
    tab_at,
    tabs_line,
    title_line,
    too_small_lines,
)
from gloc3_groundstation.tui.widgets.panel import Panel

SMALLEST: Final = (80, 24)
"""Columns and lines that every screen is made for."""
ALWAYS_SHOWN: Final = ("emergency", "help")
"""Actions whose keys are in the last line of every screen."""


class PaletteCommand(NamedTuple):
    """An entry of the command palette."""

    title: str
    help: str
    run: Callable[[], Any]


class Offer(NamedTuple):
    """A key of a screen that is not shown, for the command palette."""

    title: str
    help: str
    action: str
    part: str = ""
    """Of the screen, that has to be shown first."""


def offers(title: str, bindings: Iterable[BindingType], part: str = "") -> Iterator[Offer]:
    """Offers for those keys that have a searchable name."""
    for binding in bindings:
        if isinstance(binding, Binding) and is_reported(binding):
            yield Offer(f"{title}: {binding.description}", binding.tooltip, binding.action, part)


def is_reported(binding: Binding) -> bool:
    """Whether a key does something of the screen itself that has a name worth finding."""
    return bool(binding.show or binding.tooltip) and not binding.action.startswith(("screen.", "app."))


class ShowVehicle(Message):
    """Asks for a vehicle to be brought into view."""

    def __init__(self, platform: str) -> None:
        super().__init__()
        self.platform = platform


class StationScreen(Screen[None]):
    """A screen of the station.

    A subclass implements `body`, which yields the widgets, and `show_view`, which fills them from a view; `HELP`
    explains the screen. Both are called only while the screen is shown. Keys are `BINDINGS`, with a tooltip where the
    label is not sufficient; their actions call the desk, through `do` where that takes time.
    """

    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (110, "-wide")]
    VERTICAL_BREAKPOINTS = [(0, "-low"), (32, "-tall")]
    HELP: ClassVar[str] = ""
    """Contents of the screen and how to read it, in a few sentences; a blank line starts a paragraph."""

    def __init__(
        self, desk: Desk, rows: Sequence["ScreenRow"], row: "ScreenRow", moment: Callable[[], StationView]
    ) -> None:
        """Creates a screen; called by the app for its row.

        Args:
            desk: performs the operator's actions.
            rows: all screens.
            row: this screen.
            moment: returns the current view.
        """
        super().__init__()
        self.desk: Final = desk
        self.row: Final = row
        self._rows = rows
        self._moment = moment
        self.view: StationView | None = None
        """The displayed view; None before the first update."""
        self._styled: object = None

    # --- what a screen brings ---

    def body(self) -> ComposeResult:
        """The widgets between title and keys."""
        raise NotImplementedError

    def show_view(self, view: StationView) -> None:
        """Fills the widgets; called at 5 Hz, at once after a key that changes something, and after a change of size."""
        raise NotImplementedError

    def commands(self) -> Iterable[PaletteCommand]:
        """Commands that the palette offers on this screen besides its keys."""
        return ()

    @classmethod
    def offers(cls, title: str) -> Iterable[Offer]:
        """What the command palette offers of this screen while another one is shown."""
        return offers(title, cls.BINDINGS)

    async def show_vehicle_on_screen(self, offer: Offer) -> None:
        """Performs the offered action, once the screen is shown."""
        self.show_again()
        await self.run_action(offer.action)

    # --- what it may call ---

    def panel(self, name: str) -> Panel:
        """A panel of the body by its id."""
        return self.query_one(f"#{name}", Panel)

    def do(self, work: Awaitable[Any]) -> None:
        """Does what takes time, such as a request of the desk."""
        self.app.run_worker(work, exit_on_error=True)

    def confirm(self, question: str, yes: str, work: Callable[[], object]) -> None:
        """Asks for confirmation of a dangerous command, and runs it if the answer is yes."""

        def answered(answer: bool | None) -> None:
            if answer:
                work()

        self.app.push_screen(YesNoQuestion(question, yes), answered)

    def show_vehicle(self, name: str) -> None:
        """Selects a vehicle, on all screens."""
        self.post_message(ShowVehicle(name))

    @property
    def moment(self) -> Callable[[], StationView]:
        """Returns the current view, for dialogues that keep updating."""
        return self._moment

    def show_again(self) -> None:
        """Updates at once after a key."""
        self.show(self._moment())

    # --- the same on all screens ---

    def compose(self) -> ComposeResult:
        """Title, screens, alert, body and keys; and the message for a small terminal."""
        yield Panel(id="title", can_focus=False)
        yield Panel(id="tabs", can_focus=False)
        yield Panel(id="alert", can_focus=False)
        with Container(id="body"):
            yield from self.body()
        yield Panel(id="keys", can_focus=False)
        yield Panel(id="too_small", can_focus=False)

    def on_mount(self) -> None:
        """Keeps the line of keys up to date."""
        self.bindings_updated_signal.subscribe(self, lambda _: self._show_keys())

    def on_screen_resume(self, event: ScreenResume) -> None:
        """Shows changes since the screen was left; styles are reapplied only for another theme."""
        styled = self.app.theme, frozenset(self.app.classes)
        event.refresh_styles = styled != self._styled
        self._styled = styled
        self.call_after_refresh(self.show_again)

    def on_resize(self, event: Resize) -> None:
        """Updates the layout; shows a message where there is not enough room."""
        width, height = event.size
        is_small = width < SMALLEST[0] or height < SMALLEST[1]
        self.set_class(is_small, "-too-small")
        if is_small and self._is_there:
            self.panel("too_small").show(too_small_lines(width, height, SMALLEST, is_web=self.app.is_web))
        self.call_after_refresh(self.show_again)
        self.call_after_refresh(self._show_keys)

    def show(self, view: StationView) -> None:
        """Shows a view; in a terminal that is too small only the alert."""
        self.view = view
        width = self.size.width
        if not self._is_there or not width:
            return
        alert = alert_line(view, width)
        self.panel("alert").display = bool(alert)
        self.panel("alert").show([alert])
        if self.has_class("-too-small"):
            return
        self.panel("title").show([title_line(view, width)])
        self.panel("tabs").show([tabs_line(self._tabs, width)])
        self.show_view(view)

    def keys(self) -> list[Key]:
        """The keys that are worth showing now, those of the screen first."""
        found: dict[str, Key] = {}
        for active in self.active_bindings.values():
            binding = active.binding
            if binding.show and binding.action not in found:
                name = binding.action.rpartition(".")[2]
                key = self.app.get_key_display(binding)
                found[binding.action] = Key(key, binding.description, active.enabled, name in ALWAYS_SHOWN)
        return list(found.values())

    # --- the mouse ---

    @on(Click, "#tabs")
    async def click_tab(self, event: Click) -> None:
        """Shows the clicked screen."""
        tab = tab_at(self._tabs, self.size.width, event.x)
        row = next((row for row in self._rows if tab is not None and row.key == tab.key), None)
        if row is not None:
            await self.app.run_action(f"app.go('{row.name}')")

    @on(Click, "#alert")
    async def click_alert(self) -> None:
        """Takes note of the alert that was clicked."""
        await self.app.run_action("app.acknowledge")

    @on(Click, "#keys")
    async def click_key(self, event: Click) -> None:
        """Performs the action of the clicked key."""
        key = key_at(self.keys(), self.size.width, event.x)
        for active in self.active_bindings.values():
            binding = active.binding
            is_it = key is not None and (self.app.get_key_display(binding), binding.description) == (key.key, key.label)
            if is_it and active.enabled:
                await self.app.run_action(binding.action, active.node)
                return

    @property
    def _tabs(self) -> list[Tab]:
        return [Tab(row.key, row.title, row is self.row) for row in self._rows]

    @property
    def _is_there(self) -> bool:
        """Whether its widgets are: they come after it, and go before it when the app closes."""
        return self.is_mounted and self.is_attached and self.app.is_running

    def _show_keys(self) -> None:
        if self._is_there and self.is_current:
            self.panel("keys").show([keys_line(self.keys(), self.size.width)])


class ScreenRow(NamedTuple):
    """One screen of the station, as data."""

    name: str
    """Known by it in the configuration file."""
    key: str
    """The digit; the function key of the same number does the same."""
    title: str
    """One or two words: all titles fit in one line of 80 characters."""
    help: str
    """One line for help and palette."""
    screen: type[StationScreen]
