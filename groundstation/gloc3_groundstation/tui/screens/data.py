"""Flight data of the vehicle in view: horizon, values and strip charts."""

from typing import ClassVar, Final

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal

from gloc3_groundstation.mapping.tracks import Track
from gloc3_groundstation.tui.dialogues.fly_by_sticks import FlyBySticksDialogue
from gloc3_groundstation.tui.dialogues.teleoperate import TeleoperateDialogue
from gloc3_groundstation.tui.screen import StationScreen
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.views.flight_data import (
    CHARTS,
    WINDOWS_S,
    attitude_lines,
    attitude_title,
    charts,
    charts_title,
    shown_charts,
)
from gloc3_groundstation.tui.widgets.canvas_panel import CanvasPanel

BY_HAND: Final = "teleoperate"
"""The kind of arguments of what steers by hand."""
STICKS: Final = "sticks"
"""What steers a vehicle by its autopilot."""
STEP: Final = 0.25
"""Of the window, that a key moves it by."""


class FlightDataScreen(StationScreen):
    """Motion of the vehicle, measured and wanted."""

    HELP = """How the vehicle in view flies: its attitude on an artificial horizon, and charts of measured values (line)
    against setpoints (dotted). Chart limits are round numbers that follow the values; all charts show the same time.

    f freezes the charts; the values beside them stay live. ← and → move back and forward in the history: every sample
    of the last 10 minutes, minimum and maximum of every 2 s for an hour and of every 30 s for 8 hours.

    t opens teleoperation, with keys or a joystick, where the vehicle has that capability; a vehicle that is commanded
    through its autopilot is flown by sticks in a mode that takes them."""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f", "freeze", "Freeze", tooltip="freeze or resume the charts"),
        Binding("plus,equals_sign", "window(-1)", "Time", key_display="+ -", tooltip="shorter or longer, 10 s to 8 h"),
        Binding("minus,underscore", "window(1)", "Longer", show=False),
        Binding("left,h", "back(1)", "Back", key_display="← →", tooltip="go back and forth in time"),
        Binding("right,l", "back(-1)", "Forward", show=False),
        Binding("down,j", "scroll_charts(1)", "Charts", key_display="↑ ↓", tooltip="the charts below and above"),
        Binding("up,k", "scroll_charts(-1)", "Up", show=False),
        Binding("t", "by_hand", "Teleop", tooltip="teleoperate the vehicle in view with keys or a joystick"),
        Binding("z", "live", "Live", show=False, tooltip="return to live data"),
    ]
    AUTO_FOCUS = "#charts"
    _window = 2
    _first = 0
    _frozen_s: float | None = None
    _by_hand = ""
    """The capability by which the vehicle in view is steered by hand, or `STICKS`; empty where it has none."""

    def body(self) -> ComposeResult:
        """Attitude and values; charts."""
        with Horizontal():
            yield CanvasPanel(id="attitude", can_focus=False)
            yield CanvasPanel(id="charts")

    def show_view(self, view: StationView) -> None:
        """Draws it."""
        if (by_hand := self._steered_by(view)) != self._by_hand:
            self._by_hand = by_hand
            self.refresh_bindings()
        attitude, panel = self.query_one("#attitude", CanvasPanel), self.query_one("#charts", CanvasPanel)
        track = self._track(view)
        title = attitude_title(view, track)
        attitude.show(attitude_lines(view, track, attitude.width, attitude.size.height), title)
        width, height = panel.width, panel.size.height
        if width < 20 or height < 4:
            return
        self._first = max(0, min(self._first, len(CHARTS) - shown_charts(width, height)))
        end_s, window_s = self._end_s(view), WINDOWS_S[self._window]
        lines = charts(track, end_s, view.now_s, window_s, self._first, width, height)
        panel.show(lines, charts_title(track, end_s, view.now_s, window_s, is_frozen=self._frozen_s is not None))

    def action_freeze(self) -> None:
        """Freezes the charts, or resumes them."""
        if self.view is not None:
            self._frozen_s = None if self._frozen_s is not None else self.view.now_s
        self.show_again()

    def action_by_hand(self) -> None:
        """Steers the vehicle in view by hand."""
        platform = self.view.platform if self.view is not None else None
        if platform is None or not self._by_hand:
            return
        if self._by_hand == STICKS:
            self.app.push_screen(FlyBySticksDialogue(self.desk, platform.name, self.moment))
        else:
            self.app.push_screen(TeleoperateDialogue(self.desk, platform.name, self._by_hand, self.moment))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offers to steer by hand where the vehicle has that capability."""
        return bool(self._by_hand) if action == "by_hand" else super().check_action(action, parameters)

    def _steered_by(self, view: StationView) -> str:
        if view.platform is None:
            return ""
        if self.desk.autopilots.is_its_own(view.platform):
            return STICKS
        rows = self.desk.missions.capabilities(view.platform.name)
        return next((name for name, row in rows.items() if row.arguments == BY_HAND), "")

    def action_live(self) -> None:
        """Shows now again."""
        self._frozen_s = None
        self.show_again()

    def action_window(self, step: int) -> None:
        """Shows more or less time."""
        self._window = max(0, min(len(WINDOWS_S) - 1, self._window + step))
        self.show_again()

    def action_back(self, steps: int) -> None:
        """Moves back or forth in time; at the end the charts resume."""
        if self.view is not None:
            end_s = self._end_s(self.view) - steps * STEP * WINDOWS_S[self._window]
            self._frozen_s = None if end_s >= self.view.now_s else max(end_s, self.view.started_s)
        self.show_again()

    def action_scroll_charts(self, charts: int) -> None:
        """Shows the charts below, or above."""
        self._first += charts
        self.show_again()

    def _end_s(self, view: StationView) -> float:
        return view.now_s if self._frozen_s is None else self._frozen_s

    def _track(self, view: StationView) -> Track | None:
        return view.tracks.get(view.platform.name) if view.platform is not None else None
