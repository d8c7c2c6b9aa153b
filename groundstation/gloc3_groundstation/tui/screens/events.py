"""Events of all vehicles and the station: searched while typing, and exported to files."""

from collections.abc import Sequence
from typing import Any, Final

from msgspec.structs import replace
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.widgets import Input

from gloc3_groundstation.store.event_search import EVERYTHING, STATION, EventFilter
from gloc3_groundstation.tui.dialogues.questions import TextQuestion
from gloc3_groundstation.tui.screen import StationScreen
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.events import (
    SEVERITIES,
    event_detail,
    event_header,
    event_rows,
    filter_line,
    no_events_line,
)
from gloc3_groundstation.tui.widgets.long_list import LongList
from gloc3_groundstation.tui.widgets.panel import Panel, Row

PAUSE_S: Final = 0.01
"""Between two slices of a search, in which keys are answered and the screen is drawn."""


class EventsScreen(StationScreen):
    """A filter, the events that fit, and the one under the cursor in full."""

    HELP = """Events of the vehicles and of this station, newest last. Times count from the station's start. The
    list follows the newest event until the cursor is moved up; the key end follows it again.

    The search covers texts and names, while you type, over all events of the session, even a million. Export writes the
    matching events: a table if the file name ends in .csv, one JSON object a line if it ends in .jsonl."""
    BINDINGS = [
        Binding("slash", "type", "Search", key_display="/", tooltip="while you type; enter goes back to the list"),
        Binding("l", "severity(1)", "Severity", tooltip="raises the minimum severity; L: lowers it"),
        Binding("L", "severity(-1)", "Severity back", show=False),
        Binding("n", "platform", "Vehicle", tooltip="shows the next vehicle only, then all again"),
        Binding("o", "component", "Component", tooltip="shows the component under the cursor only, or all again"),
        Binding("e", "export", "Export", tooltip="writes the matching events to a file"),
        Binding("escape", "clear", "All", tooltip="clears the filter"),
    ]
    AUTO_FOCUS = "#events"

    def body(self) -> ComposeResult:
        """The filter, the events, and one of them."""
        yield Panel(id="filter", classes="plain line", can_focus=False)
        yield Input(id="search", placeholder="text, vehicle or component", compact=True)
        yield Panel(id="events_header", classes="plain line", can_focus=False)
        yield LongList(id="events", classes="plain")
        yield Panel(id="event")

    def on_mount(self) -> None:
        """Hides the input until it is requested."""
        super().on_mount()
        self.query_one("#search").display = False
        self._is_waiting = False

    def show_view(self, view: StationView) -> None:
        """Fills the visible part of the list, and continues the search."""
        events, desk = self.query_one(LongList), self.desk.events
        desk.search.step()
        if not desk.search.is_done and not self._is_waiting:
            self._is_waiting = True
            self.set_timer(PAUSE_S, self._go_on)
        search, store = desk.search, desk.store
        window = events.window(search)
        lines = event_rows(store.events(window), view.started_s, events.width)
        rows = [Row(line, str(number)) for number, line in zip(window, lines, strict=True)]
        events.show_rows(rows or [Row(no_events_line(search.wanted, search))])
        events.point_at(str(events.number))
        self.panel("filter").show([filter_line(search.wanted, search, len(store), self.panel("filter").width)])
        self.panel("events_header").show([event_header(events.width)])
        chosen = store.events([events.number])[0] if events.number >= 0 else None
        detail = self.panel("event")
        place = f"event {events.cursor + 1:,}" + (", following" if events.follows else "") if chosen else "event"
        detail.show(event_detail(chosen, view.started_s, view.now_s, detail.width), place)

    def _go_on(self) -> None:
        self._is_waiting = False
        if self.is_current:
            self.show_again()

    # --- the filter ---

    def search(self, **changes: Any) -> None:
        """Changes the filter."""
        desk = self.desk.events
        desk.search_for(replace(desk.search.wanted, **changes))
        self.show_again()

    def action_type(self) -> None:
        """Opens the input for the search text."""
        search = self.query_one("#search", Input)
        search.display = True
        search.focus()

    @on(Input.Changed, "#search")
    def search_as_typed(self, event: Input.Changed) -> None:
        """Searches for the text typed so far."""
        self.search(text=event.value)

    @on(Input.Submitted, "#search")
    def typed(self) -> None:
        """Goes back to the list."""
        self.query_one("#search").display = False
        self.query_one(LongList).focus()

    def action_severity(self, step: int) -> None:
        """Changes the least severity that is shown."""
        now = SEVERITIES.index(self._wanted.severity) if self._wanted.severity in SEVERITIES else 0
        self.search(severity=SEVERITIES[(now + step) % len(SEVERITIES)])

    def action_platform(self) -> None:
        """Shows the next vehicle's events."""
        self.search(
            platform=_next(["", *sorted(filter(None, self.desk.events.store.platforms))], self._wanted.platform)
        )

    def action_component(self) -> None:
        """Shows the events of the component under the cursor."""
        number = self.query_one(LongList).number
        if self._wanted.component or number < 0:
            self.search(component="")
        else:
            self.search(component=self.desk.events.store.events([number])[0].source or STATION)

    def action_clear(self) -> None:
        """Shows everything."""
        self.query_one("#search", Input).value = ""
        self.typed()
        self.desk.events.search_for(EVERYTHING)
        self.query_one(LongList).follow()
        self.show_again()

    @on(LongList.Scrolled)
    def scrolled(self) -> None:
        """Shows other rows."""
        self.show_again()

    # --- export ---

    def action_export(self) -> None:
        """Asks for a file, and writes the events that fit."""
        wanted = self._wanted

        def named(name: str | None) -> None:
            if name:
                self.do(self.desk.events.export(name, wanted))

        count = len(self.desk.events.search)
        self.app.push_screen(
            TextQuestion(f"Write {count:,} events to which file?", "events.csv", "ends in .csv or .jsonl"), named
        )

    @property
    def _wanted(self) -> EventFilter:
        return self.desk.events.search.wanted


def _next(names: Sequence[str], now: str) -> str:
    return names[(names.index(now) + 1) % len(names)] if now in names else ""
