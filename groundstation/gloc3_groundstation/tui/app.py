"""The station's terminal application: its screens, the keys common to all of them, and the 5 Hz refresh."""

import os
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, ClassVar, Final, cast
from urllib.parse import quote

import msgspec
from msgspec.structs import replace
from textual.app import App
from textual.binding import Binding, BindingType
from textual.widgets import Input, TextArea

from gloc3.messages.command_interface import EmergencyVerb
from gloc3_groundstation.announcing.announcements import Announcements
from gloc3_groundstation.desk import flights
from gloc3_groundstation.desk.autopilot_desk import OFFERS
from gloc3_groundstation.desk.desk import Desk, Move
from gloc3_groundstation.desk.flights import End
from gloc3_groundstation.mapping.tracks import Tracks
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.services.actions import Action
from gloc3_groundstation.station.alerts import answer
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.store.configuration import Configuration, ThemeName
from gloc3_groundstation.tui.browser_driver import BrowserDriver
from gloc3_groundstation.tui.dialogues.questions import (
    ABORT_QUESTION,
    FAR_QUESTION,
    LEAVE_QUESTION,
    UNSAVED_QUESTION,
    EmergencyQuestion,
    TextQuestion,
    YesNoQuestion,
    start_question,
)
from gloc3_groundstation.tui.help import help_for
from gloc3_groundstation.tui.in_view import InView
from gloc3_groundstation.tui.keys import GENERAL_KEYS
from gloc3_groundstation.tui.palette import StationCommands
from gloc3_groundstation.tui.screen import Offer, ShowVehicle, StationScreen
from gloc3_groundstation.tui.screens.mission import MissionScreen
from gloc3_groundstation.tui.screens.plugged import plugged_rows
from gloc3_groundstation.tui.screens.table import SCREENS
from gloc3_groundstation.tui.themes import THEMES, offer_themes
from gloc3_groundstation.tui.view import StationView
from gloc3_groundstation.tui.widgets.lines import Tone

REFRESH_HZ: Final = 5.0
INTERRUPTED: Final = 130
"""The exit code after Ctrl-C."""
MONOCHROME: Final = "mono"


class Opening(msgspec.Struct, frozen=True, kw_only=True):
    """Options for opening and closing the terminal."""

    platform: str | None = None
    """The selected vehicle; None for that of the mission, else of the last session, else the first one in contact."""
    is_starting: bool = False
    """Starts the selected mission without waiting for the key."""
    is_closing: bool = False
    """Closes when that mission has ended, or could not be started."""
    is_in_browser: bool = False
    """Shown to a browser by `window`, instead of in the terminal that it was started in."""
    opens: str = ""
    """A mission file that is opened at the start; one with errors is shown at the first of them."""


class StationApp(App[End | None]):
    """Renders snapshots of the fleet and hands keys to the desk; it decides nothing itself."""

    TITLE = "GLOC3 ground station"
    CSS_PATH = "station.tcss"
    COMPONENT_CLASSES = {f"tone--{tone}" for tone in Tone}
    COMMANDS = {StationCommands}
    BINDINGS: ClassVar[list[BindingType]] = [
        *GENERAL_KEYS,
        *(
            Binding(f"{row.key},f{row.key if row.key != '0' else '10'}", f"go('{row.name}')", show=False)
            for row in SCREENS
        ),
    ]

    def __init__(
        self,
        desk: Desk,
        configuration: Configuration = Configuration(),  # noqa: B008 - immutable
        opening: Opening = Opening(),  # noqa: B008 - immutable
        waiting_for: Callable[[], str] = lambda: "the link",
        announcements: Announcements | None = None,
    ) -> None:
        """Creates the terminal.

        Args:
            desk: performs the operator's actions; holds the selected mission.
            configuration: its appearance, and the state of the last session.
            opening: how it opens and closes.
            waiting_for: text for the links that are open, shown while there is no contact with a platform.
            announcements: speaks alerts, and says when the bell rings; None for neither.
        """
        is_monochrome = bool(os.environ.get("NO_COLOR"))
        driver = BrowserDriver if opening.is_in_browser else None
        super().__init__(driver, ansi_color=True if is_monochrome else None)
        self.desk: Final = desk
        self._configuration = configuration
        desk.missions.recent = configuration.session.missions
        desk.gamepad, desk.joysticks = configuration.gamepad, dict(configuration.joysticks)
        self.plugged: Final = plugged_rows(desk)
        """Screens of plug-ins."""
        self._is_monochrome = is_monochrome
        wanted = flights.addressed(desk.plan, opening.platform) if desk.plan is not None else (opening.platform,)
        self._in_view = InView(wanted[0] if len(wanted) == 1 else opening.platform, configuration.session.platform)
        self._waiting_for = waiting_for
        self._announcements = announcements
        self._opening = opening
        self._was_possible: object = None
        self._tracks = Tracks()
        desk.station.listen(self._tracks.follow)

    def on_mount(self) -> None:
        """Starts following the fleet."""
        offer_themes(self)
        self.theme = MONOCHROME if self._is_monochrome else self._configuration.theme
        for row in SCREENS:
            self.add_mode(row.name, partial(row.screen, self.desk, SCREENS, row, self.view))
        for row in self.plugged:
            self.add_mode(row.name, partial(row.screen, self.desk, SCREENS, row, self.view))
        last = [row.name for row in SCREENS if row.name == self._configuration.session.screen]
        if self._opening.opens:
            last = [row.name for row in SCREENS if row.screen is MissionScreen]
            self.call_after_refresh(self._open)
        self.switch_mode(last[0] if last else SCREENS[0].name)
        self.set_interval(1.0 / REFRESH_HZ, self.show_fleet)
        if self.desk.plan is not None:  # what is opened later is brought over when the operator says so
            self.do(self._begin(self.desk.plan))

    def get_theme_variable_defaults(self) -> dict[str, str]:
        """The variables of the style sheet that only our themes have."""
        return THEMES[0].variables

    def watch_theme(self, theme: str) -> None:
        """Uses bold and reverse in a theme without colours."""
        self.set_class(theme == MONOCHROME, "-mono")

    def configuration(self) -> Configuration:
        """The configuration to restore in the next session."""
        is_shown = self.current_mode in {row.name for row in SCREENS}  # also when the screens have gone, at the end
        screen = self.current_mode if is_shown else self._configuration.session.screen
        theme = self._configuration.theme if self._is_monochrome else cast("ThemeName", self.theme)
        last = self._configuration.session
        session = replace(last, platform=self._in_view.name, screen=screen, missions=self.desk.missions.recent)
        return replace(self._configuration, theme=theme, session=session, joysticks=self.desk.joysticks)

    # --- what is shown ---

    @property
    def window(self) -> BrowserDriver | None:
        """Driver for a browser; None before the start, and in a terminal."""
        return self._driver if isinstance(self._driver, BrowserDriver) else None

    @property
    def tracks(self) -> Tracks:
        """Where the vehicles have been."""
        return self._tracks

    @property
    def platform(self) -> PlatformSnapshot | None:
        """The platform in view."""
        return self._in_view.platform(self.desk.station.fleet)

    @property
    def base(self) -> StationScreen | None:
        """The screen that is shown, perhaps below a dialogue; None before the first and after the last."""
        found = next(iter(self.screen_stack), None)
        return found if isinstance(found, StationScreen) else None

    def view(self) -> StationView:
        """The current view of the station."""
        station, platform = self.desk.station, self.platform
        return StationView(
            fleet=station.fleet,
            platform=platform,
            now_s=station.now_s(),
            started_s=station.started_s,
            station=station.id,
            moves=self.desk.moves(platform) if platform is not None else frozenset(),
            actions=self.desk.autopilots.offers(platform) if platform is not None else (),
            plan=self.desk.plan,
            alerts=self.desk.alerts(),
            round_trip_s=station.round_trip_s(platform.name) if platform is not None else None,
            tracks=self._tracks,
            further=self.desk.plug_ins.overview(platform, station.now_s()) if platform is not None else (),
            waiting_for=self._waiting_for(),
        )

    def show_fleet(self) -> None:
        """Updates the current screen from the present fleet; panels redraw only changes."""
        self._in_view.settle(self.desk.station.fleet, self.desk.station.now_s())
        view, base = self.view(), self.base
        if self._announcements is not None and self._announcements.update(view.alerts, view.now_s):
            self.bell()
        if base is not None:
            base.show(view)
        others = min(len(view.fleet.platforms), 2) - (view.platform is not None)
        possible = view.moves, others, bool(view.alerts.pending), view.refusal is not None
        if possible != self._was_possible and self.screen_stack:  # none is there any more when it ends
            self._was_possible = possible
            self.refresh_bindings()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Greys out, or hides, the keys that make no sense now."""
        match action:
            case "cycle":
                return len(self.desk.station.fleet.platforms) > (self.platform is not None)
            case "acknowledge":
                alerts, station = self.desk.alerts(), self.desk.station
                return bool(alerts.pending) or answer(alerts, station.fleet, station.now_s()) is not None
            case "emergency":
                is_typing = isinstance(self.focused, Input | TextArea) and not parameters
                is_away = is_typing or isinstance(self.screen, EmergencyQuestion)
                return False if is_away else True if self.platform is not None else None
            case "move":
                return True if self.platform and Move(str(parameters[0])) in self.desk.moves(self.platform) else None
        return True

    # --- keys ---

    def action_go(self, name: str) -> None:
        """Shows a screen."""
        self.switch_mode(name)

    async def show_vehicle_on_screen(self, name: str, offer: Offer) -> None:
        """Shows a screen and performs the offered action there."""
        await self.switch_mode(name)
        if self.base is not None:
            await self.base.show_vehicle_on_screen(offer)

    def action_help(self) -> None:
        """Explains the screen in view and its keys."""
        if self.base is not None:
            self.push_screen(help_for(self.base, SCREENS))

    def action_acknowledge(self, is_all: bool = False) -> None:
        """Acknowledges the alert shown, or all; a refusal that is shown in its place is dismissed."""
        shown = self.base.view if self.base is not None else None
        if shown is None:
            return
        if shown.refusal is not None:
            self.desk.dismiss(shown.refusal)
        if shown.alerts.pending and (is_all or shown.refusal is None):
            self.desk.acknowledge(None if is_all else shown.alerts.pending[0].key)
        self.show_fleet()

    def action_cycle(self, step: int) -> None:
        """Shows the next platform."""
        self._in_view.cycle(self.desk.station.fleet, step)
        self.show_fleet()

    def show_vehicle(self, name: str) -> None:
        """Shows a platform."""
        self._in_view.show_vehicle(name)
        self.show_fleet()

    def on_show_vehicle(self, message: ShowVehicle) -> None:
        """Selects the platform that a screen requests."""
        self.show_vehicle(message.platform)

    def action_move(self, name: str) -> None:
        """Requests an action from the selected platform; confirms first if it arms it, starts others, or aborts."""
        platform, move = self.platform, Move(name)
        if platform is None:
            return
        work, crew = partial(self.desk.make, platform.name, move), self.desk.crew_of(platform.name)
        if move is Move.ABORT:
            question = ABORT_QUESTION.format(platform.name, self.desk.missions.after_abort(platform))
            self.confirm(question, "abort", lambda: self.do(work()))
        elif distance := self.desk.far_away(platform.name, move):

            def allowed() -> None:
                self.desk.allow_far(platform.name)
                self.action_move(name)

            self.confirm(FAR_QUESTION.format(distance[0].upper() + distance[1:]), "upload", allowed)
        elif move is Move.START and (crew != (platform.name,) or not platform.is_armed):
            question = start_question(self.desk.mission_to_start(platform), crew)
            self.confirm(question, "start", lambda: self.do(work()))
        else:
            self.do(work())

    def action_emergency(self, is_typing: bool = False) -> None:
        """Holds at once; pressed again it offers more, and leaves a landing that was chosen there under way."""
        platform = self.platform
        if platform is None:
            return
        last = self.desk.last_emergency(platform.name)
        if last in (None, EmergencyVerb.HOLD):  # it may have been resumed since
            self.do(self.desk.emergency(platform.name, EmergencyVerb.HOLD))
        if last is None:
            return

        def chosen(choice: tuple[EmergencyVerb, str] | Action | None) -> None:
            if isinstance(choice, Action):
                self.do(self.desk.autopilots.act(platform.name, choice))
            elif choice is not None:
                self.do(self.desk.emergency(platform.name, *choice))

        question = EmergencyQuestion(platform.name, returns=self.desk.autopilots.is_its_own(platform))
        self.push_screen(question, chosen)

    def action_act(self, name: str) -> None:
        """Commands the autopilot of the selected vehicle; asks for values, and before what moves it."""
        platform, action = self.platform, Action(name)
        if platform is None:
            return
        vehicle, offer = platform.name, OFFERS[action]

        def send(typed: str | None) -> None:
            if typed is None:
                return
            work = partial(self.desk.autopilots.act, vehicle, action, typed)
            if offer.question:
                question = f"{offer.question.format(vehicle)}{f' ({typed})' if typed else ''}"
                self.confirm(question, offer.title.lower(), lambda: self.do(work()))
            else:
                self.do(work())

        if offer.values:
            self.push_screen(TextQuestion(f"{offer.title}: {vehicle}", hint=offer.values), send)
        else:
            send("")

    def action_corrections(self) -> None:
        """Asks for the source of RTK corrections; for its password, if it lacks one, without showing it."""

        def start(url: str, password: str | None = None) -> None:
            before, at, after = url.rpartition("@")
            secret = "" if password is None else f":{quote(password, safe='')}"
            self.do(self.desk.fleet.start_corrections(f"{before}{secret}{at}{after}"))

        def named(url: str | None) -> None:
            user, has_user, _ = (url or "").partition("://")[2].rpartition("@")
            if not url:
                return
            if has_user and ":" not in user:
                question = TextQuestion(f"Password of {user}?", is_secret=True)
                self.push_screen(question, lambda typed: start(url, typed) if typed else None)
            else:
                start(url)

        hint = "ntrip://USER@HOST:2101/MOUNTPOINT, tcp://HOST:PORT, serial:///dev/ttyACM0:115200"
        self.push_screen(TextQuestion("RTK corrections from where?", hint=hint), named)

    def action_end_corrections(self) -> None:
        """Takes no RTK corrections any more."""
        self.do(self.desk.fleet.stop_corrections())

    def action_leave(self) -> None:
        """Closes; confirms first while this station controls an armed vehicle, or a mission is not saved."""
        armed, draft = self.desk.armed_in_our_control(), self.desk.missions.draft
        questions = [LEAVE_QUESTION.format(", ".join(armed))] if armed else []
        if draft is not None and self.desk.missions.has_unsaved:
            questions.append(UNSAVED_QUESTION.format(draft.name))
        if not questions:
            self.exit(None)
        else:
            self.confirm("\n\n".join(questions), "quit", lambda: self.exit(None))

    def action_interrupt(self) -> None:
        """Ctrl-C copies the selection in the editor; otherwise it closes at once, in a browser like the key q."""
        if isinstance(self.focused, TextArea) and self.focused.selected_text:
            self.focused.action_copy()
        elif self.is_web:
            self.action_leave()
        else:
            self.interrupt()

    def interrupt(self) -> None:
        """Closes at once, without asking."""
        self.exit(None, return_code=INTERRUPTED)

    # --- work that takes time ---

    def confirm(self, question: str, yes: str, work: Callable[[], object]) -> None:
        """Asks for confirmation of a dangerous command, and runs it if the answer is yes."""

        def answered(answer: bool | None) -> None:
            if answer:
                work()

        self.push_screen(YesNoQuestion(question, yes), answered)

    def do(self, work: Awaitable[Any]) -> None:
        """Runs an operation in the background; its result appears in the fleet."""
        self.run_worker(work, exit_on_error=True)

    async def _open(self) -> None:
        if isinstance(self.base, MissionScreen):
            await self.base.open(self._opening.opens)

    async def _begin(self, plan: CheckedPlan) -> None:
        """Brings the mission of the command line to its vehicle at the first contact; starts it, if requested."""
        name = await self.desk.await_contact(plan, self._opening.platform)
        if self.desk.plan is not None and self.desk.plan.text != plan.text:
            return  # the operator has another one now
        if self.platform is not None and self.platform.name == name:
            self.show_vehicle(name)  # it stays in view
        if self._opening.is_starting:
            end = await self.desk.fly(name) if name else None
            if self._opening.is_closing:
                self.exit(end)
        elif name:
            await self.desk.bring(name)
