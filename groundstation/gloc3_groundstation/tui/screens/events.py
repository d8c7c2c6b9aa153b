"""Everything that has happened, on all vehicles and in the station."""

from textual.app import ComposeResult

from gloc3_groundstation.tui.panel import Panel
from gloc3_groundstation.tui.screen import StationScreen
from gloc3_groundstation.tui.view import View
from gloc3_groundstation.tui.views.events import event_lines


class EventsScreen(StationScreen):
    """Events, the newest last."""

    HELP = """What the vehicles have told and what this station did, the newest last. Times count from the station's
    start. The panel follows the end until it is scrolled up."""

    def body(self) -> ComposeResult:
        """One panel."""
        yield Panel(id="events", follows_end=True)

    def look(self, view: View) -> None:
        """Fills it."""
        events = self.panel("events")
        events.show(event_lines(view.fleet, view.started_s, events.width), f"events: {view.fleet.event_count}")
