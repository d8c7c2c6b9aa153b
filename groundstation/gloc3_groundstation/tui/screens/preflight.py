"""Pre-flight list of the selected vehicle: the checks before every start."""

from collections.abc import Sequence
from typing import Final

from textual.app import ComposeResult
from textual.binding import Binding

from gloc3.messages.preflight import Check, red
from gloc3_groundstation.desk.desk import Move
from gloc3_groundstation.desk.preflight_desk import CheckList
from gloc3_groundstation.tui.dialogues.questions import TextQuestion
from gloc3_groundstation.tui.screen import StationScreen
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.overview import waiting_lines
from gloc3_groundstation.tui.views.preflight import no_list_lines, preflight_headline, preflight_rows, preflight_title
from gloc3_groundstation.tui.widgets.lines import cut
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel, Row

OVERRIDE_QUESTION: Final = "Start {} although checks are red?\n{}\n\nGive a reason; it is logged with your name."
LINE: Final = 56
"""Characters of each red line in the question."""
SHOWN: Final = 4
"""Most failed checks shown in the question; the list behind it shows all."""
SHOWN_OF_EACH: Final = 2
"""The same of each vehicle, where several start; the list of each shows all."""


class PreflightScreen(StationScreen):
    """The list of checks, each ok or with what to do."""

    HELP = """The checks before every start of the vehicle in view: autopilot and its setup, failsafes against the
    platform file, sensors, components, mission, computer, and link. The autopilot's parameters are read again for each
    list, every 15 seconds while it is shown.

    A red line refuses the start. Follow the advice after the arrow, then refresh. Starting despite a red line needs a
    reason, which is logged onboard with your name. Warnings and unknown lines do not refuse the start.

    A mission that names several vehicles starts on all of them or on none: the override shows the red lines of each, and
    is for all of them."""
    BINDINGS = [
        Binding("r", "refresh", "Refresh", tooltip="refreshes the list"),
        Binding("s", "app.move('start')", "Start", tooltip="the mission; uploaded first if needed"),
        Binding("o", "override", "Override", tooltip="starts despite red lines, with a typed reason"),
        Binding("u", "app.move('stream')", "Upload", tooltip="uploads the open mission"),
        Binding("c", "app.move('control')", "Control", tooltip="requests control of the vehicle in view"),
    ]
    AUTO_FOCUS = "#checks"

    def body(self) -> ComposeResult:
        """What it means, and the list."""
        yield Panel(id="headline", classes="plain line", can_focus=False)
        yield ListPanel(id="checks")

    _style_class: object = None
    """State on which the displayed keys depend."""

    def show_view(self, view: StationView) -> None:
        """Fills the list, and requests a new one when it is old."""
        panel, headline = self.query_one("#checks", ListPanel), self.panel("headline")
        checks = self._list(view)
        can_start = Move.START in view.moves
        headline.show([preflight_headline(view.platform, checks, headline.width, can_start=can_start)])
        if view.platform is None or checks is None:
            panel.show_rows([Row(line) for line in waiting_lines(view)], "checks")
            return
        for name in {view.platform.name, *self.desk.crew_of(view.platform.name)}:
            known = view.fleet.get(name)
            if known is not None and known.has_companion and self.is_current and self.desk.preflight.is_due(name):
                self.do(self.desk.preflight.refresh(name))
        rows = [Row(*row) for row in preflight_rows(checks, panel.width - 1, has_plan=view.plan is not None)]
        if not rows:
            rows = [Row(line) for line in no_list_lines(view.platform, checks.problem, panel.width - 1)]
        panel.show_rows(rows, preflight_title(checks))
        bad = red(checks.checks)
        style_class = bool(bad), can_start, self._is_refused(view)
        if style_class != self._style_class:
            self._style_class = style_class
            self.refresh_bindings()
            if bad:
                panel.point_at(bad[0].title)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offers the override where a start would be refused."""
        if action == "override":
            view = self.view
            return True if view is not None and Move.START in view.moves and self._is_refused(view) else None
        if action == "refresh":
            platform = self.view.platform if self.view is not None else None
            return True if platform is not None and platform.has_companion else None
        return super().check_action(action, parameters)

    def action_refresh(self) -> None:
        """Requests a new list."""
        if self.view is not None and self.view.platform is not None and self.view.platform.has_companion:
            self.do(self.desk.preflight.refresh(self.view.platform.name))
            self.show_again()

    def action_override(self) -> None:
        """Asks for the reason, then starts."""
        view = self.view
        if view is None or view.platform is None:
            return
        name, crew, lines = view.platform.name, self._crew(view), list[str]()
        for one, checks in crew.items():
            whose, bad = f"{one}: " * (len(crew) > 1), red(checks)
            most = SHOWN if len(crew) == 1 else SHOWN_OF_EACH
            lines += [cut(f"✗ {whose}{check.title}: {check.finding}", LINE) for check in bad[:most]]
            lines += [f"{whose}and {len(bad) - most} more"] * (len(bad) > most)
            lines += [f"{whose}its checks are not known yet"] * (not checks)

        def typed(reason: str | None) -> None:
            if reason:
                self.do(self.desk.start(name, override=reason))

        self.app.push_screen(TextQuestion(OVERRIDE_QUESTION.format(", ".join(crew), "\n".join(lines))), typed)

    def _crew(self, view: StationView) -> dict[str, Sequence[Check]]:
        """The vehicles that a start would start, each with its checks; empty ones where they are not known."""
        crew = self.desk.crew_of(view.platform.name) if view.platform is not None else ()
        known = {name: view.fleet.get(name) for name in crew}
        return {name: self.desk.preflight.list_of(one).checks if one else () for name, one in known.items()}

    def _is_refused(self, view: StationView) -> bool:
        """Whether a red line of any vehicle that would start refuses the start."""
        return any(red(checks) for checks in self._crew(view).values())

    def _list(self, view: StationView) -> CheckList | None:
        return self.desk.preflight.list_of(view.platform) if view.platform is not None else None
