"""Overview: the fleet, the vehicle in view, alerts and recent events."""

from functools import partial
from typing import Final

from textual import on
from textual.app import ComposeResult
from textual.containers import Grid

from gloc3_groundstation.tui.keys import MISSION_KEYS
from gloc3_groundstation.tui.screen import StationScreen
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.events import event_lines
from gloc3_groundstation.tui.views.mission.lines import mission_lines, mission_title
from gloc3_groundstation.tui.views.overview import (
    alert_lines,
    alerts_title,
    detail_lines,
    detail_title,
    vehicle_header,
    vehicle_line,
    waiting_lines,
)
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel, Row
from gloc3_groundstation.tui.widgets.vehicle_rows import VehicleRows

ROOMY: Final = 170
"""Columns from which the vehicle's details have two columns."""
HIGH: Final = 48
"""Lines from which all of the details are shown."""


class OverviewScreen(StationScreen):
    """The fleet, the selected vehicle with its mission, the alerts and recent events."""

    HELP = """The state of the fleet at a glance. Each vehicle has a line; ► marks the vehicle in view, which receives
    the commands. Below are its details, its mission, the alerts of all vehicles, and recent events.

    Stale values are shown in italics: the last ones received. An alert stays until it is acknowledged and its cause is
    gone."""
    BINDINGS = MISSION_KEYS
    AUTO_FOCUS = "#vehicles"

    _seen = ""
    """The vehicle that was in view; the cursor goes with it when another comes into view."""

    def body(self) -> ComposeResult:
        """Vehicles; facts, mission and alerts side by side; events."""
        self._kept = VehicleRows()
        yield Panel(id="vehicles_header", classes="plain line", can_focus=False)
        yield ListPanel(id="vehicles", classes="plain")
        with Grid(id="overview"):
            yield Panel(id="facts")
            yield Panel(id="mission")
            yield Panel(id="alerts")
            yield Panel(id="events", follows_end=True)

    def show_view(self, view: StationView) -> None:
        """Fills the panels."""
        grid = self.query_one("#overview")
        grid.set_class(self.size.width >= ROOMY, "-roomy")
        grid.set_class(self.size.height >= HIGH, "-high")
        vehicles, snapshot, mission = self.query_one(ListPanel), self.panel("facts"), self.panel("mission")
        alerts, events = self.panel("alerts"), self.panel("events")
        self.panel("vehicles_header").show([vehicle_header(view, vehicles.width)] if view.fleet.platforms else [()])
        rows = self._kept.rows(vehicles, view, partial(vehicle_line, view, width=vehicles.width), view.alerts)
        vehicles.show_rows(rows or [Row(line) for line in waiting_lines(view)])
        if view.platform is not None and view.platform.name != self._seen:
            self._seen = view.platform.name
            vehicles.point_at(self._seen)
        vehicles.styles.height = max(1 if rows else 4, min(len(rows), self.size.height // 3))
        snapshot.show(detail_lines(view, snapshot.width), detail_title(view))
        lines = mission_lines(view.platform, view.plan, view.now_s, mission.width - 1)
        mission.show(lines, mission_title(view.platform, view.now_s))
        alerts.show(alert_lines(view, alerts.width), alerts_title(view))
        events.show(event_lines(view.fleet, view.started_s, events.width), "events")

    @on(ListPanel.Chosen, "#vehicles")
    def look_at(self, event: ListPanel.Chosen) -> None:
        """Brings a vehicle into view."""
        self.show_vehicle(event.key)
