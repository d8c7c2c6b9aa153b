"""All vehicles and links: commands to a selection, control of the vehicle in view, opening and closing links."""

from functools import partial

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding

from gloc3.messages.command_interface import ControlVerb
from gloc3_groundstation.desk.desk import Order
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.tui.dialogues.questions import TextQuestion, YesNoQuestion
from gloc3_groundstation.tui.screen import StationScreen
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.fleet import (
    control_lines,
    fleet_header,
    fleet_line,
    fleet_title,
    link_header,
    link_lines,
    unwatched_lines,
)
from gloc3_groundstation.tui.views.overview import waiting_lines
from gloc3_groundstation.tui.widgets.lines import Span, Tone
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel, Row
from gloc3_groundstation.tui.widgets.vehicle_rows import VehicleRows

QUESTIONS = {
    Order.HOLD: "Hold: {}?\nEach stops and holds position; missions are paused.",
    Order.PAUSE: "Pause the missions of {}?",
    Order.RESUME: "Resume the missions of {}?\nEach continues where it was paused.",
    Order.LAND: "Land now, where they are: {}?",
    Order.START: "Start: {}?\nThe open mission is uploaded first if needed. They arm and take off.",
}
SINGLE_VEHICLE_ORDERS = (Order.LAND, Order.START)
"""Orders that also require confirmation for the selected vehicle; for marked ones all do."""
OVERRIDE_QUESTION = "Take over control of {} from station {}?\nIts operator is not asked; the takeover is logged."
FORWARD_QUESTION = (
    "Let commands from there pass to the vehicles?\nThe vehicles then obey that station as they obey this one."
)
CLOSE_QUESTION = "Close {}?\n{} can no longer be reached over it; on_link_loss of its mission applies."


class FleetScreen(StationScreen):
    """Vehicles above, control of the one in view, links below."""

    HELP = """All vehicles that are heard, and all links. The vehicle under the cursor is the vehicle in view, which
    receives the commands of all screens.

    Marked vehicles are commanded together: hold, pause, resume, land, start, after a confirmation that names them.
    Without a mark the command goes to the vehicle in view, and only land and start ask for confirmation.

    One station controls a vehicle at a time. The controlling station has 10 seconds to grant or refuse a request; a
    takeover needs no permission, and is logged. Tab moves to the links."""
    BINDINGS = [
        Binding("m", "mark", "Mark", tooltip="the vehicle under the cursor, for commands to several"),
        Binding("M", "mark_all", "Mark all", show=False, tooltip="or none, if all are"),
        Binding("h", "order('hold')", "Hold", tooltip="the marked vehicles, or the one in view"),
        Binding("p", "order('pause')", "Pause"),
        Binding("r", "order('resume')", "Resume"),
        Binding("l", "order('land')", "Land", tooltip="here and now, as the emergency key does"),
        Binding("s", "order('start')", "Start", tooltip="uploads the open mission if needed, and starts it"),
        Binding("c", "control('request')", "Control", tooltip="requests control of the vehicle in view"),
        Binding("g", "control('grant')", "Grant", tooltip="gives control to the requesting station"),
        Binding("f", "control('refuse')", "Refuse", tooltip="keeps control; the requesting station is notified"),
        Binding("t", "control('take_over')", "Take over", tooltip="takes control without permission; asks first"),
        Binding("z", "control('release')", "Release", tooltip="gives control back"),
        Binding("n", "add_link", "New link", tooltip="udpin://, udpout://, tcpin://, tcpout://, serial://"),
        Binding("w", "forward", "Forward", show=False, tooltip="sends the vehicles' frames to another station"),
        Binding("delete", "remove_link", "Close link", tooltip="the link under the cursor"),
    ]
    AUTO_FOCUS = "#vehicles"

    def body(self) -> ComposeResult:
        """Vehicles, control, links."""
        yield Panel(id="vehicles_header", classes="plain line", can_focus=False)
        yield ListPanel(id="vehicles", classes="plain")
        yield Panel(id="control", can_focus=False)
        yield Panel(id="links_header", classes="plain line", can_focus=False)
        yield ListPanel(id="links", classes="plain")

    def on_mount(self) -> None:
        """Nothing is marked."""
        super().on_mount()
        self._marked: set[str] = set()
        self._seen = ""
        self._rests_at = ""
        self._offered: object = None
        self._kept = VehicleRows()

    def show_view(self, view: StationView) -> None:
        """Fills the panels."""
        vehicles, control, links = self.query_one("#vehicles", ListPanel), self.panel("control"), self._links
        marked = self._selection(is_marked_only=True)
        self.panel("vehicles_header").show(
            [fleet_header(view, vehicles.width)] if view.fleet.platforms or view.fleet.regions else [()]
        )
        make = partial(fleet_line, view, marked=marked, width=vehicles.width)
        rows = self._kept.rows(vehicles, view, make, tuple(marked))
        rows = [*rows, *(Row(line) for line in unwatched_lines(view, vehicles.width))]
        vehicles.show_rows(rows or [Row(line) for line in waiting_lines(view)])
        if view.platform is not None and view.platform.name != self._seen:
            self._seen = view.platform.name
            vehicles.point_at(self._seen)
        is_in_view = view.platform is None or vehicles.chosen == view.platform.name
        self._rests_at = vehicles.chosen if is_in_view else ""
        possible = self.desk.fleet.control_verbs(view.platform) if view.platform is not None else frozenset()
        lines = control_lines(view, possible, vehicles.width)
        control.styles.height = max(len(lines), 2) + 1
        control.show(lines, fleet_title(view, marked))
        known = self.desk.fleet.links()
        self.panel("links_header").show([link_header(links.width)])
        none = [Row((Span(" There is no link; n opens one.", Tone.DIM),))]
        rows = [
            Row(line, link.url if number == 0 else "")
            for link in known
            for number, line in enumerate(link_lines(link, links.width))
        ]
        links.show_rows(rows or none)
        links.styles.height = max(2, min(len(rows), self.size.height // 4))
        offered = possible, self.focused is links, bool(view.fleet.platforms)
        if offered != self._offered:
            self._offered = offered
            self.refresh_bindings()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Disables actions that are not possible now; a request for control can be answered only while there is one."""
        platform = self.view.platform if self.view is not None else None
        if action == "control":
            verb = ControlVerb(str(parameters[0]))
            is_possible = platform is not None and verb in self.desk.fleet.control_verbs(platform)
            return is_possible or (None if verb is ControlVerb.REQUEST else False)
        if action in ("order", "mark", "mark_all"):
            return True if platform is not None else None
        if action == "remove_link":
            return self.focused is self._links
        return True

    @on(ListPanel.Moved, "#vehicles")
    def moved(self, event: ListPanel.Moved) -> None:
        """Brings the vehicle under the cursor into view."""
        is_there = event.panel.chosen == event.key
        if event.key and is_there and self.view is not None:
            in_view = self.view.platform.name if self.view.platform is not None else self._rests_at
            self._seen = event.key
            if event.key != in_view:
                self.show_vehicle(event.key)

    # --- orders ---

    def action_mark(self) -> None:
        """Marks the vehicle under the cursor, or takes its mark away."""
        self._marked ^= {self.query_one("#vehicles", ListPanel).chosen}
        self.show_again()

    def action_mark_all(self) -> None:
        """Marks all vehicles, or none."""
        everyone = set(self.desk.station.fleet.platforms)
        self._marked = set() if everyone <= self._marked else everyone
        self.show_again()

    def action_order(self, name: str) -> None:
        """Sends an order; confirms first, with the vehicles' names, for marked vehicles or a dangerous order."""
        order, names = Order(name), self._selection()
        is_for_marked = bool(self._selection(is_marked_only=True))
        if order is Order.START:
            names = list(dict.fromkeys(one for name in names for one in self.desk.crew_of(name)))
        work = partial(self.desk.order, names, order)
        if names and (is_for_marked or order in SINGLE_VEHICLE_ORDERS):
            self.confirm(QUESTIONS[order].format(", ".join(names)), order, lambda: self.do(work()))
        elif names:
            self.do(work())

    def action_control(self, name: str) -> None:
        """Changes control of the selected vehicle."""
        platform, verb = self._selected(), ControlVerb(name)
        if platform is None:
            return
        work = self.desk.fleet.control
        if verb is not ControlVerb.TAKE_OVER:
            self.do(work(platform.name, verb))
            return
        holder = platform.control.value.holder if platform.control is not None else "?"
        question = OVERRIDE_QUESTION.format(platform.name, holder)
        self.confirm(question, "take over", lambda: self.do(work(platform.name, verb)))

    def _selection(self, *, is_marked_only: bool = False) -> list[str]:
        """The marked vehicles; without any, the selected one."""
        marked, selected = self.desk.fleet.named(self._marked), self._selected()
        return marked if marked or is_marked_only or selected is None else [selected.name]

    def _selected(self) -> PlatformSnapshot | None:
        """The vehicle in view; that under the cursor while a key has moved it and its messages are on their way."""
        chosen = self.query_one("#vehicles", ListPanel).chosen
        return self.moment().platform if chosen == self._rests_at else self.desk.station.fleet.get(chosen)

    # --- links ---

    def action_add_link(self) -> None:
        """Asks for a URL, and opens it."""

        def named(url: str | None) -> None:
            if url:
                self.do(self.desk.fleet.add_link(url))

        hint = "udpin://0.0.0.0:14551, tcpout://HOST:5760, serial:///dev/ttyUSB0:57600"
        self.app.push_screen(TextQuestion("Open which link?", "", hint), named)

    def action_forward(self) -> None:
        """Asks for the URL of another station, and whether its commands pass to the vehicles."""

        def named(url: str | None) -> None:
            if not url:
                return

            def answered(is_both: bool | None) -> None:
                self.do(self.desk.fleet.forward_to(url, is_both=bool(is_both)))

            self.app.push_screen(YesNoQuestion(FORWARD_QUESTION, "let them pass", "one way only"), answered)

        hint = "udpout://HOST:14550, tcpout://HOST:5760"
        self.app.push_screen(TextQuestion("Forward the vehicles' frames to which station?", "", hint), named)

    def action_remove_link(self) -> None:
        """Closes the link under the cursor; confirms first if vehicles are behind it."""
        url = self._links.chosen
        behind = [name for link in self.desk.fleet.links() if link.url == url for name in link.platforms]
        if not url:
            return
        if not behind:
            self.do(self.desk.fleet.remove_link(url))
            return
        question = CLOSE_QUESTION.format(url, ", ".join(behind))
        self.confirm(question, "close it", lambda: self.do(self.desk.fleet.remove_link(url)))

    @property
    def _links(self) -> ListPanel:
        return self.query_one("#links", ListPanel)
