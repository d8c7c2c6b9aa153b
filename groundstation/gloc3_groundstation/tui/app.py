"""The station's terminal: a screen with the vehicle, its components, its mission and the events, and the keys."""

from collections.abc import Awaitable, Callable, Iterable
from typing import Any, ClassVar, Final

from textual.app import App, ComposeResult, SystemCommand
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.screen import Screen
from textual.widgets import Footer

from gloc3.ci import EmergencyVerb, Verb
from gloc3_groundstation.desk import Desk, Move
from gloc3_groundstation.flights import End
from gloc3_groundstation.snapshots import PlatformSnapshot
from gloc3_groundstation.tui.components_view import component_lines, components_title
from gloc3_groundstation.tui.events_view import event_lines
from gloc3_groundstation.tui.mission_view import mission_lines, mission_title
from gloc3_groundstation.tui.panel import Panel
from gloc3_groundstation.tui.questions import EmergencyQuestion, Question
from gloc3_groundstation.tui.theme import THEME
from gloc3_groundstation.tui.vehicle_view import title_line, vehicle_lines

REFRESH_HZ: Final = 5.0
INTERRUPTED: Final = 130
"""The exit code after Ctrl-C."""


class StationApp(App[End | None]):
    """Renders snapshots of the fleet and hands keys to the desk; it decides nothing itself."""

    TITLE = "GLOC3 ground station"
    CSS_PATH = "station.tcss"
    ENABLE_COMMAND_PALETTE = False
    AUTO_FOCUS = None
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("s", "start", "Start"),
        Binding("p", "steer('pause')", "Pause"),
        Binding("r", "steer('resume')", "Resume"),
        Binding("a", "abort", "Abort"),
        Binding("u", "stream", "Upload"),
        Binding("c", "control", "Control"),
        Binding("space", "emergency", "HOLD", priority=False),
        Binding("n", "next", "Next vehicle"),
        Binding("q", "leave", "Quit"),
        Binding("ctrl+c", "interrupt", show=False, priority=True),
    ]

    def __init__(
        self,
        desk: Desk,
        *,
        platform: str | None = None,
        waiting_for: Callable[[], str] = lambda: "the link",
        is_starting: bool = False,
        is_closing: bool = False,
    ) -> None:
        """The terminal.

        Args:
            desk: where keys lead to; with the mission at hand.
            platform: the one in view; None for the first that is heard.
            waiting_for: what is listened to, told while no platform is heard.
            is_starting: starts the mission at hand without waiting for the key.
            is_closing: closes when that mission has ended, or could not be started.
        """
        super().__init__()
        self._desk = desk
        self._in_view = platform
        self._waiting_for = waiting_for
        self._is_starting = is_starting
        self._is_closing = is_closing
        self._has_begun = False
        self._moves: frozenset[Move] = frozenset()

    def compose(self) -> ComposeResult:
        """The panels, from top to bottom."""
        yield Panel(id="title", can_focus=False)
        yield Panel(id="vehicle", can_focus=False)
        with Horizontal(id="middle"):
            yield Panel(id="components")
            yield Panel(id="mission")
        yield Panel(id="events", follows_end=True)
        yield Footer(show_command_palette=False)

    def on_mount(self) -> None:
        """Begins to look at the fleet."""
        self.register_theme(THEME)
        self.theme = THEME.name
        self.query_one("#events").border_title = "events"
        self.set_interval(1.0 / REFRESH_HZ, self.look)
        self.call_after_refresh(self.look)

    @property
    def platform(self) -> PlatformSnapshot | None:
        """The platform in view."""
        fleet = self._desk.station.fleet
        if self._in_view is None:
            return next(iter(fleet), None)
        return fleet.get(self._in_view)

    def look(self) -> None:
        """Shows the fleet as it is now; panels draw only what has changed."""
        station, platform = self._desk.station, self.platform
        fleet, now_s = station.fleet, station.now_s()
        panels = {panel.id: panel for panel in self.screen_stack[0].query(Panel)}
        title, vehicle, components = panels["title"], panels["vehicle"], panels["components"]
        mission, events = panels["mission"], panels["events"]
        title.show([title_line(fleet, platform, station.id, station.started_s, now_s, title.width)])
        vehicle.show(vehicle_lines(platform, now_s, self._waiting_for()))
        components.show(component_lines(platform, now_s, components.width), components_title(platform, now_s))
        mission.show(mission_lines(platform, self._desk.plan, now_s, mission.width - 1), mission_title(platform, now_s))
        events.show(event_lines(fleet, station.started_s, events.width))
        moves = self._desk.moves(platform) if platform is not None else frozenset()
        if moves != self._moves:
            self._moves = moves
            self.refresh_bindings()
        if platform is not None and not self._has_begun and self._desk.plan is not None:
            self._has_begun = True
            self._run(self._fly(platform.name) if self._is_starting else self._desk.bring(platform.name))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Greys out the keys that make no sense now."""
        if action == "next":
            return len(self._desk.station.fleet.platforms) > 1
        if action == "steer":
            action = str(parameters[0])
        if action in list(Move):
            return True if Move(action) in self._moves else None
        return True

    def get_system_commands(self, screen: Screen[Any]) -> Iterable[SystemCommand]:
        """None: every key is shown."""
        return ()

    # --- keys ---

    def action_start(self) -> None:
        """Starts the mission."""
        if self.platform is not None:
            self._run(self._desk.start(self.platform.name))

    def action_stream(self) -> None:
        """Streams the mission at hand."""
        if self.platform is not None:
            self._run(self._desk.stream(self.platform.name))

    def action_control(self) -> None:
        """Asks for control."""
        if self.platform is not None:
            self._run(self._desk.take_control(self.platform.name))

    def action_steer(self, verb: str) -> None:
        """Pauses or resumes the mission."""
        if self.platform is not None:
            self._run(self._desk.steer(self.platform.name, Verb(verb)))

    def action_abort(self) -> None:
        """Aborts the mission, once confirmed."""
        platform = self.platform
        if platform is None:
            return

        def answered(answer: bool | None) -> None:
            if answer:
                self._run(self._desk.steer(platform.name, Verb.ABORT))

        question = (
            f"Abort the mission of {platform.name}?\nIts actions are cancelled, then its on_failure policy is flown."
        )
        self.push_screen(Question(question, "abort"), answered)

    def action_emergency(self) -> None:
        """Holds at once; pressed again it offers more."""
        platform = self.platform
        if platform is None:
            return
        if not self._desk.was_just_held(platform.name):
            self._run(self._desk.emergency(platform.name, EmergencyVerb.HOLD))
            return

        def chosen(choice: tuple[EmergencyVerb, str] | None) -> None:
            if choice is not None:
                self._run(self._desk.emergency(platform.name, *choice))

        self.push_screen(EmergencyQuestion(platform.name), chosen)

    def action_next(self) -> None:
        """Looks at the next platform."""
        names = list(self._desk.station.fleet.platforms)
        if self.platform is not None:
            self._in_view = names[(names.index(self.platform.name) + 1) % len(names)]
            self.look()

    def action_leave(self) -> None:
        """Closes; asks first while this station holds control of an armed vehicle."""
        armed = self._desk.armed_in_our_control()
        if not armed:
            self.exit(None)
            return

        def answered(answer: bool | None) -> None:
            if answer:
                self.exit(None)

        question = f"{', '.join(armed)} is armed and in this station's control.\nWithout it, the mission's on_link_loss policy decides."
        self.push_screen(Question(question, "quit"), answered)

    def action_interrupt(self) -> None:
        """Closes at once, asking nothing: Ctrl-C, or a signal to the process."""
        self.exit(None, return_code=INTERRUPTED)

    # --- work that takes time ---

    def _run(self, work: Awaitable[Any]) -> None:
        self.run_worker(work, exit_on_error=True)

    async def _fly(self, name: str) -> None:
        end = await self._desk.fly(name)
        if self._is_closing:
            self.exit(end)
