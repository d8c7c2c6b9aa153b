"""The health of the vehicle in view: every component, and one of them in full."""

from typing import Final

from textual import on
from textual.app import ComposeResult

from gloc3_groundstation.tui.list_panel import ListPanel, Row
from gloc3_groundstation.tui.panel import Panel
from gloc3_groundstation.tui.screen import StationScreen
from gloc3_groundstation.tui.view import View
from gloc3_groundstation.tui.views.components import (
    component_lines,
    component_rows,
    components_header,
    components_title,
    health_counts,
)

AROUND: Final = 8
"""Lines that are left to what stands above and below the components."""


class HealthScreen(StationScreen):
    """Components from the samplers to the command interface, in the order of the data."""

    HELP = """Every component of the vehicle in view in the order of the data: SS samples, DP processes, CC controls,
    AD drives, CI commands. Rate is measured against nominal; load is the share of the period that a cycle takes; late
    counts the cycles that did not end in time.

    The component under the cursor is told in full below, with its last error."""
    AUTO_FOCUS = "#components"

    def body(self) -> ComposeResult:
        """The components, and the one under the cursor."""
        yield Panel(id="counts", classes="plain line", can_focus=False)
        yield Panel(id="components_header", classes="plain line", can_focus=False)
        yield ListPanel(id="components", classes="plain")
        yield Panel(id="component")

    def look(self, view: View) -> None:
        """Fills the panels."""
        components, component = self.query_one(ListPanel), self.panel("component")
        self.panel("counts").show([health_counts(view.platform, view.now_s)])
        self.panel("components_header").show([components_header(components.width)])
        rows = component_rows(view.platform, view.now_s, components.width)
        components.show_rows([Row(line, name) for name, line in rows], components_title(view.platform, view.now_s))
        components.styles.height = min(len(rows), self.query_one("#body").size.height - AROUND)
        name = components.chosen
        component.show(component_lines(view.platform, name, view.now_s, component.width), name)

    @on(ListPanel.Moved, "#components")
    def tell(self) -> None:
        """Tells the component under the cursor."""
        self.look_again()
