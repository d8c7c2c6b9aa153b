"""One run of the station in wall time: opens the links, shows or narrates, and closes everything in order."""

import asyncio
import gc
import getpass
import os
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from gloc3.cli.narration import narrate
from gloc3.clock import Clock
from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.envelope import Severity
from gloc3_groundstation.announcing.announcements import AlertLevel, Announcements, severity_of
from gloc3_groundstation.announcing.speech import NONE_FOUND, Speech, find_program
from gloc3_groundstation.assembly import GroundStation, StationSetup
from gloc3_groundstation.cli.ending import Ending
from gloc3_groundstation.cli.headless import Headless
from gloc3_groundstation.cli.run_output import RunOutput
from gloc3_groundstation.cli.script import ScriptCommand, parse_command, read_lines
from gloc3_groundstation.desk.vehicle_commands import VehicleCommand
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.reporting.outcomes import RunOutcome, findings_of, outcome_of
from gloc3_groundstation.shared_missions.shared_flight import CrewOptions
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store.configuration import Configuration, unsaved_folder
from gloc3_groundstation.web.certificate import fingerprint
from gloc3_groundstation.web.live_view import LiveView
from gloc3_groundstation.web.map_view import MapSource
from gloc3_groundstation.web.server import WebOptions, WebServer, exposure
from gloc3_groundstation.web.terminal_view import Notify, TerminalWindow

if TYPE_CHECKING:
    from gloc3_groundstation.desk.desk import Desk


class SessionOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of the command line."""

    urls: tuple[str, ...] = ()
    """The links."""
    modems: tuple[tuple[str, str], ...] = ()
    """Acoustic modems: the platform that each leads to, and its URL."""
    platform: str | None = None
    """Platform to command; None for the first one received."""
    plan: CheckedPlan | None = None
    """The selected mission."""
    crew: CrewOptions = CrewOptions()
    """Vehicles for it, where its tasks are for any platform."""
    configuration: Configuration = Configuration()
    """Appearance of the terminal, and its last position."""
    problem: str = ""
    """Why the configuration file could not be used; empty where it could."""
    foxglove_port: int | None = None
    """Where Foxglove is served; None for nowhere."""
    forward: tuple[str, ...] = ()
    """Links to other stations, one way."""
    forward_both: tuple[str, ...] = ()
    """Links to other stations, whose commands pass to the vehicles."""
    rtk: str = ""
    """Source of RTK corrections; empty for none."""
    bell: AlertLevel = "off"
    """Alerts that ring the terminal's bell."""
    speech: AlertLevel = "off"
    """Alerts that are spoken."""


class HeadlessOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of a session without a terminal."""

    wait_s: float = 60.0
    """Longest wait for contact with the platform."""
    override: str = ""
    """Why the mission shall start although checks are red; empty to have it refused then."""
    is_at_contact: bool = False
    """Brings the mission over at the next contact, however long that takes, and starts nothing."""
    commands: tuple[ScriptCommand, ...] = ()
    """Sent at their times after the start."""
    orders: tuple[VehicleCommand, ...] = ()
    """Commands to each vehicle, one after the other, without a mission."""
    vehicles: tuple[str, ...] = ()
    """The vehicles that get them; `all` for every one that is heard."""
    within_s: float = 120.0
    """The time for each of them to be done."""
    is_taking_over: bool = False
    """Takes control from another station without asking it."""
    is_far_ok: bool = False
    """The mission's first waypoint may be kilometres from the vehicle."""
    commands_from: int | None = None
    """A file descriptor from which further commands are read, a line each; None for none."""


class TerminalOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of a session in the terminal."""

    is_starting: bool = False
    """Starts the selected mission without waiting for the key."""
    is_closing: bool = False
    """Closes when that mission has ended."""
    web: WebOptions | None = None
    """Where it is shown to a browser; None for the terminal that it was started in."""
    opens: str = ""
    """A mission file with errors, which is shown at the first of them."""


class Session:
    """A run of the station that can be run once.

    Args:
        setup: setup of the station.
        options: options of the run.
        ending: ends it.
    """

    def __init__(self, setup: StationSetup, options: SessionOptions, ending: Ending) -> None:
        self._setup, self._options, self._ending = setup, options, ending

    async def narrate(self, options: HeadlessOptions, output: RunOutput) -> RunOutcome:
        """Flies the selected mission, or only monitors.

        Args:
            options: of the run.
            output: receives the lines.
        """
        requested = self._options
        async with self._ground() as ground:
            run = Headless(
                ground.station,
                output.line,
                platform=requested.platform,
                crew=requested.crew,
                is_taking_over=options.is_taking_over,
            )
            if requested.problem:
                run.narrate(requested.problem, Severity.WARNING)
            run.narrate(f"listening on {ground.links.describe()}")
            work = asyncio.ensure_future(self._work(run, ground, options))
            with self._ending.requested(work.cancel), _commanded(run, options):
                try:
                    return await work
                except Gloc3Error as error:
                    run.narrate(str(error), Severity.ERROR)
                    output.findings(findings_of(error))
                    return outcome_of(error)
                except asyncio.CancelledError:
                    run.narrate(wording.farewell(ground.station.fleet))
                    is_watching = requested.plan is None and not options.orders
                    return RunOutcome.DONE if is_watching else RunOutcome.INTERRUPTED

    async def show(self, options: TerminalOptions, keep: Callable[[Configuration], bool]) -> int:
        """Opens the terminal.

        Args:
            options: of the terminal.
            keep: receives the configuration when the terminal closes; returns whether it could be saved.

        Returns:
            The exit code.
        """
        if options.web is not None:
            os.environ.setdefault("TEXTUAL_COLOR_SYSTEM", "truecolor")  # read by Textual when it is loaded
        from gloc3_groundstation.tui.app import Opening, StationApp

        requested = self._options
        async with self._ground() as ground, self._announcing(ground.station) as announcements:
            station = ground.station
            app = StationApp(
                ground.desk(requested.plan, is_queue_kept=True, author=operator()),
                requested.configuration,
                Opening(
                    platform=requested.platform,
                    is_starting=options.is_starting,
                    is_closing=options.is_closing,
                    is_in_browser=options.web is not None,
                    opens=options.opens,
                ),
                waiting_for=ground.links.describe,
                announcements=announcements,
            )
            app.desk.crew.options = requested.crew
            app.desk.keep = lambda: keep(app.configuration())
            if requested.problem:
                station.note("", Severity.WARNING, requested.problem)
            gc.freeze()  # what is loaded stays: a search for garbage among it would hold keys up for a tenth of a second
            kept: list[Path] = []

            def keep_unsaved() -> None:
                path = None if kept else app.desk.missions.keep_unsaved(unsaved_folder())
                kept.extend([path] if path is not None else [])

            def interrupt() -> None:
                keep_unsaved()  # at once: a terminal that takes nothing more may keep the screens from closing
                app.interrupt()

            with self._ending.requested(interrupt, None if options.web is not None else sys.stdin.fileno()):
                if options.web is None:
                    end = await app.run_async()
                else:
                    source = MapSource(app.desk, lambda: app.tracks)
                    async with _served(source, options.web, lambda: app.window):
                        end = await app.run_async()
            if not keep(app.configuration()) and not requested.problem:
                narrate("warning: the configuration file cannot be written: this session is not kept")
            keep_unsaved()
            for path in kept:
                narrate(f"unsaved changes are in {path}")
            for line in _summary(station):
                narrate(line)
            if end is None:
                narrate(wording.farewell(station.fleet))
                return app.return_code or int(options.is_closing)
            return end.exit_code

    @asynccontextmanager
    async def _announcing(self, station: Station) -> AsyncIterator[Announcements]:
        """What announces alerts; a missing speech program is reported."""
        bell, spoken = severity_of(self._options.bell), severity_of(self._options.speech)
        warn = partial(station.note, "", Severity.WARNING)
        program = None if spoken is None else find_program()
        if program is None:
            if spoken is not None:
                warn(NONE_FOUND)
            yield Announcements(bell=bell)
            return
        speech = Speech(program, warn)
        try:
            yield Announcements(bell=bell, speech=spoken, speak=speech.speak)
        finally:
            await speech.close()

    async def _work(self, run: Headless, ground: GroundStation, options: HeadlessOptions) -> RunOutcome:
        """What a run without a terminal is for."""
        plan = self._options.plan
        if options.orders:
            return await run.do(
                ground.desk().commands, options.vehicles, options.orders, options.wait_s, options.within_s
            )
        if plan is None:
            return await run.watch()
        if options.is_at_contact:
            return await self._leave(run, plan, ground)
        author = operator() if options.override else ""
        end = await run.fly(plan, options.wait_s, options.override, author, is_far_ok=options.is_far_ok)
        return outcome_of(end)

    async def _leave(self, run: Headless, plan: CheckedPlan, ground: GroundStation) -> RunOutcome:
        """Queues a mission, and waits until it is there.

        Raises:
            Gloc3Error: it is refused.
        """
        queue = ground.begin_queue(is_kept=False)
        async with run.narrating():
            error = await queue.ended(queue.add(self._options.platform or "", plan))
        if error is not None:
            raise error
        return RunOutcome.DONE

    @asynccontextmanager
    async def _ground(self) -> AsyncIterator[GroundStation]:
        """The station with its links, and with Foxglove's view of it, if requested."""
        ground, view = GroundStation(self._setup), None
        try:
            await ground.open(self._options.urls, self._options.modems)
            for url in self._options.forward:
                await ground.links.forward(url, is_both=False)
            for url in self._options.forward_both:
                await ground.links.forward(url, is_both=True)
            if self._options.rtk:
                await ground.corrections.open(self._options.rtk)
            if self._options.foxglove_port is not None:
                offset_s = Clock(ground.loop).utc_offset_s
                view = LiveView(ground.station, ground.exchange, ground.loop, ground.topics, offset_s)
                url = view.open(self._options.foxglove_port)
                ground.station.note("", Severity.NOTICE, f"Foxglove is served, view only: {url}")
            yield ground
        finally:
            self._ending.begin()
            if view is not None:
                view.close()
            await ground.close()


@contextmanager
def _commanded(run: Headless, options: HeadlessOptions) -> Iterator[None]:
    """The commands of the script, without the lines that are none, which are reported."""

    def receive(line: str) -> None:
        try:
            run.command(parse_command(line))
        except Refused as refusal:
            run.narrate(str(refusal), Severity.WARNING)

    for command in options.commands:
        run.command(command)
    if options.commands_from is None:
        yield
        return
    stop = read_lines(asyncio.get_running_loop(), options.commands_from, receive)
    try:
        yield
    finally:
        stop()


@asynccontextmanager
async def _served(
    source: MapSource, options: WebOptions, window: Callable[[], TerminalWindow | None]
) -> AsyncIterator[None]:
    """Serves the pages for browsers, and narrates their viewers in the terminal that started the station."""
    desk = source.desk

    def warn(text: str) -> None:
        desk.station.note("", Severity.WARNING, text)
        narrate(f"warning: {text}")

    async with WebServer(window, options, reporter(desk), warn, source).serving() as addresses:
        if options.is_exposed:
            narrate(exposure(addresses, operator()))
        if options.certificate is not None:
            narrate(f"the certificate's SHA-256 is {fingerprint(options.certificate[0])}")
        if addresses.watch:
            narrate(
                f"read-only, the station is at {addresses.watch}" + " (Ctrl-C here ends it)" * (not addresses.command)
            )
        if addresses.command:
            narrate(f"the station is at {addresses.command} (Ctrl-C here ends it)")
        yield


def reporter(desk: "Desk") -> Notify:
    """Reports viewers in the terminal and as events; the loss of the last one is a warning while a vehicle needs it."""

    def reported(text: str, is_watched: bool) -> None:
        armed = [] if is_watched else desk.armed_in_our_control()
        if armed:
            text = f"{text}; {', '.join(armed)}: armed and controlled by this station, on_link_loss does not start"
        desk.station.note("", Severity.WARNING if armed else Severity.NOTICE, text)
        narrate(text)

    return reported


def operator() -> str:
    """Name of the operator at this station for logged actions; empty where the system does not provide it."""
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # a user without a name, as in a container
        return ""


def _summary(station: Station) -> list[str]:
    """What is worth reading after the terminal has closed."""
    lines = []
    for event in station.fleet.events:
        if event.severity <= Severity.WARNING:
            who = ": ".join(part for part in (event.platform, event.source) if part)
            clock = wording.clock(event.received_s - station.started_s)
            lines.append(f"{clock}  {event.severity.name.lower()}: {who + ': ' if who else ''}{event.text}")
    for platform in station.fleet:
        if platform.mission is not None and platform.mission.value.state:
            mission = platform.mission.value
            reason = f" ({mission.reason})" if mission.reason else ""
            lines.append(f"{platform.name}: {mission.name!r} is {mission.state}{reason}")
    return lines
