"""One run of the station in wall time: opens the links, shows or narrates, and closes everything in order."""

import asyncio
import gc
import getpass
import os
import secrets
import signal
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gloc3.clock import Clock
from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange import LocalExchange
from gloc3.messages import Severity
from gloc3.narrate import narrate
from gloc3.network.file import Membership
from gloc3.topics import TopicTable
from gloc3_groundstation import wording
from gloc3_groundstation.acoustic_way import Modem, open_modem
from gloc3_groundstation.configuration import Configuration, unsaved_folder
from gloc3_groundstation.contact_queue import FILE as QUEUE_FILE
from gloc3_groundstation.contact_queue import ContactQueue
from gloc3_groundstation.event_store import EventStore
from gloc3_groundstation.events_desk import EventsDesk
from gloc3_groundstation.headless import Headless
from gloc3_groundstation.kept_state import SHOWN, SILENCES, FeedFile, SilenceFile
from gloc3_groundstation.links import Links
from gloc3_groundstation.live_view import LiveView
from gloc3_groundstation.narration import Line
from gloc3_groundstation.network_way import role_of
from gloc3_groundstation.plans import Plan
from gloc3_groundstation.recording import Recording
from gloc3_groundstation.services_desk import ServicesDesk
from gloc3_groundstation.station import Station
from gloc3_groundstation.vehicles import Vehicles
from gloc3_groundstation.web import Told, WebOptions, WebServer, Window, exposure

if TYPE_CHECKING:
    from gloc3_groundstation.desk import Desk

INTERRUPTED: Final = 128 + signal.SIGINT


class Session:
    """What was asked for on the command line, ready to be run once."""

    def __init__(
        self,
        urls: Sequence[str],
        system: int,
        platform: str | None,
        plan: Plan | None,
        configuration: Configuration = Configuration(),  # noqa: B008 - immutable
        problem: str = "",
        record: Path | None = None,
        *,
        signing_key: bytes | None = None,
        foxglove_port: int | None = None,
        network: Membership | None = None,
        modems: Sequence[tuple[str, str]] = (),
    ) -> None:
        """A run.

        Args:
            urls: the links.
            system: the station's MAVLink system.
            platform: the one to command; None for the first that is heard.
            plan: the mission at hand.
            configuration: how the terminal looks, and where it was left.
            problem: why the configuration file could not be used; empty where it could.
            record: the folder in which the session is recorded, in a folder of its own; None for nowhere.
            signing_key: signs all links; None for links that are not signed.
            foxglove_port: where Foxglove is served; None for nowhere.
            network: the network file of this station; None for MAVLink alone.
            modems: acoustic modems: the platform that each leads to, and its URL.
        """
        self._network = network
        self._acoustic = list(modems)
        self._urls = list(urls)
        self._system = system
        self._platform = platform
        self._plan = plan
        self._configuration = configuration
        self._problem = problem
        self._signing_key = signing_key
        self._foxglove_port = foxglove_port
        self._links = Links()
        self._record = record
        self._events: EventsDesk | None = None
        self._services: ServicesDesk | None = None
        self._queue: ContactQueue | None = None

    async def narrate(
        self,
        wait_s: float,
        data: Callable[[Line], None] | None = None,
        override: str = "",
        *,
        is_at_contact: bool = False,
    ) -> int:
        """Flies the mission at hand, or watches; narrates on stderr.

        Args:
            wait_s: how long the platform may take to be heard.
            data: takes the same as data.
            override: why it shall start although checks are red; empty to have it refused then.
            is_at_contact: brings the mission over at the next contact, however long that takes, and starts nothing.

        Returns:
            The exit code.
        """

        def tell(line: Line) -> None:
            narrate(str(line))
            if data is not None:
                data(line)

        async with self._station() as station:
            run = Headless(station, tell, platform=self._platform)
            if self._problem:
                run.say(f"warning: {self._problem}")
            run.say(f"listening on {self._links.describe()}")
            work = asyncio.ensure_future(
                run.watch()
                if self._plan is None
                else self._leave(run, self._plan, station)
                if is_at_contact
                else self._fly(run, self._plan, wait_s, override)
            )
            loop = asyncio.get_running_loop()
            for number in (signal.SIGINT, signal.SIGTERM):
                loop.add_signal_handler(number, work.cancel)
            try:
                return await work or 0
            except asyncio.CancelledError:
                run.say(wording.farewell(station.fleet))
                return 0 if self._plan is None else INTERRUPTED

    async def show(
        self,
        *,
        is_starting: bool,
        is_closing: bool,
        keep: Callable[[Configuration], bool],
        web: WebOptions | None = None,
        opens: str = "",
    ) -> int:
        """Opens the terminal.

        Args:
            is_starting: starts the mission at hand without waiting for the key.
            is_closing: closes when that mission has ended.
            keep: is given the configuration when the terminal closes; tells whether it could be kept.
            web: where it is shown to a browser; None for the terminal that it was started in.
            opens: a mission file with errors, which is shown at the first of them.

        Returns:
            The exit code.
        """
        if web is not None:
            os.environ.setdefault("TEXTUAL_COLOR_SYSTEM", "truecolor")  # read by Textual when it is loaded
        from gloc3_groundstation.desk import Desk
        from gloc3_groundstation.tui.app import StationApp

        async with self._station() as station:
            file = None if self._record is None else self._record / f"{station.id}-{QUEUE_FILE}"
            self._queue = ContactQueue(station, file)
            app = StationApp(
                Desk(
                    station,
                    self._plan,
                    events=self._events,
                    services=self._services,
                    links=self._links,
                    queue=self._queue,
                    author=operator(),
                ),
                self._configuration,
                platform=self._platform,
                waiting_for=self._links.describe,
                is_starting=is_starting,
                is_closing=is_closing,
                is_in_browser=web is not None,
                opens=opens,
            )
            loop = asyncio.get_running_loop()
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                loop.add_signal_handler(number, app.interrupt)
            if self._problem:
                station.note("", Severity.WARNING, self._problem)
            gc.freeze()  # what is loaded stays: a search for garbage among it would hold keys up for a tenth of a second
            if web is None:
                end = await app.run_async()
            else:
                async with _served(app.desk, web, lambda: app.window):
                    end = await app.run_async()
            if not keep(app.configuration()) and not self._problem:
                narrate("warning: the configuration file cannot be written: this session is not kept")
            kept = app.desk.missions.keep_unsaved(unsaved_folder())
            if kept is not None:
                narrate(f"the changes that were not saved are in {kept}")
            for line in _summary(station):
                narrate(line)
            if end is None:
                narrate(wording.farewell(station.fleet))
                return app.return_code or int(is_closing)
            return 0 if end.is_done else 1

    async def _leave(self, run: Headless, plan: Plan, station: Station) -> int:
        """Queues a mission, and waits until it is there or refused."""
        name = self._platform or next(iter(plan.platforms), "")
        if not name or len(plan.platforms) > 1:
            raise Refused("--at-contact needs --platform, and a mission for one")
        self._queue = ContactQueue(station)
        async with run.narrating():
            return 1 if await self._queue.ended(self._queue.add(name, plan)) else 0

    @staticmethod
    async def _fly(run: Headless, plan: Plan, wait_s: float, override: str) -> int:
        try:
            return 0 if (await run.fly(plan, wait_s, override, operator() if override else "")).is_done else 1
        except Gloc3Error as error:
            run.say(f"error: {error}")
            return 1

    @asynccontextmanager
    async def _station(self) -> AsyncIterator[Station]:
        topics = TopicTable.installed()
        exchange = LocalExchange(topics)
        boot = secrets.randbits(32)
        loop = asyncio.get_running_loop()
        name = str(self._system) if self._network is None else self._network.file.member
        shown = None if self._record is None else FeedFile(self._record / f"{name}-{SHOWN}", loop)
        station = Station(exchange, loop, name, boot, None if shown is None else shown.feed)
        silences = None if self._record is None else SilenceFile(self._record / f"{name}-{SILENCES}", station, loop)
        if self._network is not None:
            station.client.role = role_of(self._network)
        station.round_trip_s = self._links.round_trip_s
        recording = self._begin_recording(station, loop, topics)
        store = EventStore(recording.events if recording else None, Clock(loop).utc_offset_s)
        self._events = EventsDesk(station, store)
        vehicles = Vehicles(station, self._links.ways)
        folder = Path(self._configuration.downloads or ".").expanduser()
        self._services = ServicesDesk(station, vehicles.reach, folder)
        view: LiveView | None = None
        modems: list[Modem] = []
        try:
            if recording is not None:
                recording.attach(exchange)
            await self._links.open(
                self._urls,
                exchange=exchange,
                topics=topics,
                system=self._system,
                boot=boot,
                told=lambda text: station.note("", Severity.WARNING, text),
                undelivered=station.client.undelivered,
                tap=recording.frame if recording else lambda _: None,
                signing_key=self._signing_key,
                network=self._network,
            )
            for platform, url in self._acoustic:
                modems.append(await open_modem(platform, url, station, exchange, boot))
            view = self._serve_foxglove(station, exchange, loop, topics)
            yield station
        finally:
            if view is not None:
                view.close()
            vehicles.close()
            if self._queue is not None:
                self._queue.close()
            for modem in modems:
                await modem.close()
            await self._services.close()
            if silences is not None:
                silences.close()
            station.close()
            if shown is not None:
                shown.close()
            await self._links.close()
            if recording is not None:
                recording.close()
            store.close()

    def _serve_foxglove(
        self, station: Station, exchange: LocalExchange, loop: asyncio.AbstractEventLoop, topics: TopicTable
    ) -> LiveView | None:
        """Foxglove's view of the vehicles, if it was asked for."""
        if self._foxglove_port is None:
            return None
        view = LiveView(station, exchange, loop, topics, Clock(loop).utc_offset_s)
        url = view.open(self._foxglove_port)
        station.note("", Severity.NOTICE, f"Foxglove is served, view only: {url}")
        return view

    def _begin_recording(
        self, station: Station, loop: asyncio.AbstractEventLoop, topics: TopicTable
    ) -> Recording | None:
        """The logs of this session; without a place for them the station works all the same, and says so."""
        if self._record is None:
            return None

        def tell(text: str) -> None:
            station.note("", Severity.WARNING, text)

        try:
            return Recording(self._record, Clock(loop), loop, topics, station.id, tell)
        except Gloc3Error as error:
            tell(str(error))
            return None


@asynccontextmanager
async def _served(desk: "Desk", options: WebOptions, window: Callable[[], Window | None]) -> AsyncIterator[None]:
    """The page for a browser, and what is said of it in the terminal that the station was started in."""
    async with WebServer(window, options, teller(desk)).serving() as url:
        if options.is_exposed:
            narrate(exposure(url, operator()))
        narrate(f"the station is at {url} (Ctrl-C here ends it)")
        yield


def teller(desk: "Desk") -> Told:
    """Tells in the terminal, and among the events, who looks; that nobody does is a warning while a vehicle needs it."""

    def told(text: str, is_watched: bool) -> None:
        armed = [] if is_watched else desk.armed_in_our_control()
        if armed:
            text = f"{text}; {', '.join(armed)}: armed and in this station's control, on_link_loss does not begin"
        desk.station.note("", Severity.WARNING if armed else Severity.NOTICE, text)
        narrate(text)

    return told


def operator() -> str:
    """Who is at this station, for what is logged with a name; empty where the system does not tell."""
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
            clock = wording.clock(event.heard_s - station.started_s)
            lines.append(f"{clock}  {event.severity.name.lower()}: {who + ': ' if who else ''}{event.text}")
    for platform in station.fleet:
        if platform.mission is not None and platform.mission.value.state:
            mission = platform.mission.value
            reason = f" ({mission.reason})" if mission.reason else ""
            lines.append(f"{platform.name}: {mission.name!r} is {mission.state}{reason}")
    return lines
