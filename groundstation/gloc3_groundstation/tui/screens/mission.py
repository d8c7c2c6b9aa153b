"""The mission of the vehicle in view, task by task."""

from textual.app import ComposeResult

from gloc3_groundstation.tui.keys import MISSION_KEYS
from gloc3_groundstation.tui.panel import Panel
from gloc3_groundstation.tui.screen import StationScreen
from gloc3_groundstation.tui.view import View
from gloc3_groundstation.tui.views.mission import mission_lines, mission_title


class MissionScreen(StationScreen):
    """Tasks and actions with their states, and the keys that steer them."""

    HELP = """The mission that is loaded on the vehicle in view: its tasks in order, each with its actions.

    Start streams the mission at hand first, if that has not been done. Pause ends every motion in a hold; resume goes
    on from there. Abort cancels all actions, then flies the mission's on_failure policy."""
    BINDINGS = MISSION_KEYS

    def body(self) -> ComposeResult:
        """One panel."""
        yield Panel(id="mission")

    def look(self, view: View) -> None:
        """Fills it."""
        mission = self.panel("mission")
        lines = mission_lines(view.platform, view.plan, view.now_s, mission.width - 1)
        mission.show(lines, mission_title(view.platform, view.now_s))
