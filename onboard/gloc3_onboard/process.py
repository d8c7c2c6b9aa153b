"""The onboard process in wall time: opens links and files, hosts the components, and stops cleanly."""

import asyncio
import faulthandler
import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from random import SystemRandom
from typing import Any, Final, Literal

from gloc3.ci import StationRole
from gloc3.clock import Clock, utc_now
from gloc3.context import HostContext
from gloc3.counting import counted
from gloc3.errors import Gloc3Error, InputError, Refused
from gloc3.exchange.base import Exchange
from gloc3.exchange.link_budget import budget_of
from gloc3.host import ComponentHost
from gloc3.link.endpoints import Endpoint, open_endpoint, parse_url
from gloc3.link.message import MavlinkMessage
from gloc3.link.parser import Frame
from gloc3.link.router import Router
from gloc3.link.signing import Signing
from gloc3.link.signing_key import read_signing_key
from gloc3.messages import Envelope, Event, Severity
from gloc3.narrate import Narrator, narrate
from gloc3.network.file import Membership, read_network
from gloc3.network.stations import StationBridge
from gloc3.places import Place, choose_host, clock_host, host_names, rows_at
from gloc3.platform import Platform
from gloc3.platform_reader import find_platform, load_platform
from gloc3.readiness import LinkCondition, SensorCondition
from gloc3.requested_path import RequestedPath
from gloc3.store import RecordFile
from gloc3_onboard.acoustic_link import AcousticLink
from gloc3_onboard.arm_authority import ArmAuthority
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.autopilot.news import LinkNews
from gloc3_onboard.command_server.log_shelf import LogShelf
from gloc3_onboard.command_server.site import Site
from gloc3_onboard.companion.companion import Companion
from gloc3_onboard.companion.files import shared_files
from gloc3_onboard.companion.own_parameters import own_parameters
from gloc3_onboard.computer import HostComputer, start_of_computer
from gloc3_onboard.herald import Herald
from gloc3_onboard.link_watch import LinkWatch
from gloc3_onboard.log_files import LogFiles, log_stem
from gloc3_onboard.nodes.host_clock import ClockServer
from gloc3_onboard.nodes.host_process import HostOptions, run_host
from gloc3_onboard.nodes.host_watch import HostWatch
from gloc3_onboard.nodes.keeper import HostKeeper
from gloc3_onboard.nodes.pipe import Order
from gloc3_onboard.nodes.shared import Shared, alone, check_member, open_shared, renew
from gloc3_onboard.process_options import ProcessOptions
from gloc3_onboard.rate_watch import RateWatch
from gloc3_onboard.rig import PlatformRig
from gloc3_onboard.routing import RoutedLink
from gloc3_onboard.run_log import RunLog
from gloc3_onboard.runner import HOST_DEVICES, Onboard
from gloc3_onboard.sensor_watch import SensorWatch
from gloc3_onboard.service.manager import ServiceManager
from gloc3_onboard.service.service import Service
from gloc3_onboard.signing_memory import SigningMemory
from gloc3_onboard.sources.asked import is_asked_here, source_urls
from gloc3_onboard.sources.factory import SourceHost, make_sources
from gloc3_onboard.sources.url import Sensor
from gloc3_onboard.station_link import HeartbeatSource, StationLink
from gloc3_onboard.storage import PictureFolder
from gloc3_onboard.taps import ExchangeTaps
from gloc3_onboard.viewer.catalogue import Catalogue
from gloc3_onboard.vitals import VitalSigns

DEVICES: Final = (*HOST_DEVICES, *Sensor, *(f"*_{sensor}" for sensor in Sensor))
"""What this host has; installed packages bring more."""


def _lament(options: ProcessOptions, _kind: str, text: str) -> None:
    """Tells of messages that could not be taken."""
    if not options.is_quiet:
        narrate(f"onboard: {text}", Severity.WARNING)


async def run(options: ProcessOptions) -> int:
    """Runs until a signal.

    Raises:
        InputError: the platform file is wrong.
        Refused: a link or a camera cannot be had.
    """
    warn = None if options.is_quiet else lambda found: narrate(str(found), Severity.WARNING)
    platform = load_platform(options.platform, is_loading_classes=True, devices=DEVICES, warn=warn)
    loop = asyncio.get_running_loop()
    manager = ServiceManager.of_this_process(os.environ, lambda text: narrate(text, Severity.WARNING))
    if manager.is_there:
        faulthandler.enable()  # its watchdog ends us by SIGABRT: then the journal says where we hung
    host = choose_host(platform, options.host)
    member = None if options.network is None else read_network(options.network, utc_now())
    check_member(platform, host, member)
    opened = partial(open_shared, platform, host, options.folder(platform), loop, partial(_lament, options), member)
    if host != clock_host(platform):
        share = HostOptions(
            platform=options.platform,
            logs=options.logs or options.folder(platform),
            devices=options.devices,
            log_limits=options.log_limits,
            is_quiet=options.is_quiet,
            network=options.network,
        )
        await run_host(share, platform, host, opened, manager)
        manager.close()
        return 0
    with opened() as shared:
        process = OnboardProcess(options, platform, loop, shared, member)
        service = Service(manager, process, loop)
        try:
            await process.open()
            await service.run()
        finally:
            await process.close()
            manager.close()
    return 0


class OnboardProcess:
    """Everything that the main process of the clock host holds open."""

    def __init__(
        self,
        options: ProcessOptions,
        platform: Platform,
        loop: asyncio.AbstractEventLoop,
        shared: Shared | None = None,
        member: Membership | None = None,
    ) -> None:
        self._options, self._platform, self._loop = options, platform, loop
        shared = shared or alone()
        self._place = Place(choose_host(platform, options.host))
        self._clock = Clock(loop)
        self._topics = shared.topics
        self.exchange: Final[Exchange] = shared.exchange
        """What the components say to each other."""
        self._endpoint = shared.endpoint
        self._narrator = Narrator()
        self._random = SystemRandom()
        self._out = options.folder(platform)
        self._logs = options.logs or self._out
        self._endpoints: list[Endpoint] = []
        self._routed: list[RoutedLink] = []
        self._stations: list[StationLink] = []
        self._signing_memory = SigningMemory(self._out, self._clock, lambda text: self.say(Severity.WARNING, text))
        self._news = LinkNews(self.exchange, platform.platform, self._random.getrandbits(32), loop.time)
        self._authority = ArmAuthority(self.exchange, platform.platform)
        self._autopilot = AutopilotLink(
            loop,
            self._clock,
            options.system_id,
            self._autopilot_says,
            self._signing(options.autopilot, 0, None),
            lambda: self._authority.why_not(loop.time()),
        )
        self._router = Router(self._autopilot.own, self._system_restarted)
        self._modem: AcousticLink | None = None
        self._log: RunLog | None = None
        self._readers = ThreadPoolExecutor(2, "logs")
        self._herald = Herald(self.exchange, platform.platform, self._autopilot.own, self._loop, self._tell_stations)
        self._may_write = True
        self._companion = Companion(
            self._autopilot.own,
            platform,
            self.exchange,
            self._clock,
            self._loop,
            self._random.getrandbits(32),
            VitalSigns(self._logs).look,
            own_parameters(self._tell_from, self._allow_writing),
            takes_plans=options.takes_plans,
        )
        folder = find_platform(options.platform).parent
        self._rig = PlatformRig(platform, folder)
        for warning in self._rig.warnings:
            self.say(Severity.WARNING, str(warning))
        self._rows = rows_at(platform, self._place)
        used = sorted({device for row in self._rows for device in row.devices.values()})
        asked = [each for each in options.devices if is_asked_here(platform, used, each)]
        urls = source_urls(platform, used, asked)
        source_host = SourceHost(loop, folder, self._autopilot.t_s_of_boot, self._autopilot.sensors, self._autopilot)
        self._sources = make_sources(urls, source_host)
        self._watch = SensorWatch(urls, self._sources, self._rig, self._clock.now_s)
        self._computer = HostComputer(
            self._logs, self._clock, self._log_problem, self._link_conditions, self._sensor_conditions
        )
        context = HostContext(platform.platform, self.exchange, self._clock, loop, shared.topics, self._random)
        self._context = context
        self._keeper = HostKeeper(
            platform,
            self._place.host,
            context,
            self._order,
            lambda text: self.say(Severity.WARNING, text),
            sensors=self._watch.conditions,
            vehicle_boot_s=lambda: self._autopilot.t_s_of_boot(0.0),
        )
        self._network_news = LinkNews(
            self.exchange, platform.platform, self._random.getrandbits(32), loop.time, source="network"
        )
        self._on_network = (
            None
            if member is None
            else StationBridge(
                self.exchange, loop, platform.platform, member.file.roles, self._random.getrandbits(32), self._forged
            )
        )
        self._clock_server = ClockServer(self.exchange, platform.platform, loop)
        self._host_watch = HostWatch(context, self._place.host, host_names(platform), self.say)
        self._onboard: Onboard | None = None
        self._link_watch = LinkWatch(loop, self._endpoints, self.say)
        self._path = RequestedPath(self.exchange, platform.platform)
        self.exchange.subscribe(f"{platform.platform}/components/*/event", self._narrate)

    async def open(self) -> None:
        """Opens the links and the log, and brings the components up."""
        platform, options = self._platform, self._options
        await self._open_link(options.autopilot, self._autopilot)
        for number, url in enumerate(options.stations, 1):
            signing = self._signing(url, number, options.signing_key)
            link = StationLink(
                platform.platform,
                options.system_id,
                self._loop,
                self.exchange,
                self._topics,
                self._random.getrandbits(32),
                budget_of(url, is_signed=signing is not None),
                signing,
                StationRole(parse_url(url).role),
                parse_url(url).address,
            )
            self._stations.append(link)
            await self._open_link(url, link)
        if options.acoustic:
            await self._open_modem(options.acoustic)
        HeartbeatSource(
            self.exchange,
            platform.platform,
            lambda: [self._autopilot.send_message, *(station.send for station in self._stations)],
        )
        await self._loop.run_in_executor(None, self._computer.measure)
        log = self._open_log()
        self._share()
        self._keeper.begin()
        devices = self._devices(log)
        self._onboard = Onboard(platform, self._context, devices, rows=self._rows, led=self._keeper.led)
        self._onboard.begin()
        self.say(Severity.INFO, f"{platform.platform}: {len(platform.components)} components; log in {log}")
        self._link_watch.begin()

    @property
    def platform(self) -> Platform:
        """Which it is, as it was begun."""
        return self._platform

    @property
    def hosts(self) -> Mapping[str, ComponentHost]:
        """Its components, once it is open."""
        return {} if self._onboard is None else self._onboard.hosts

    def read_platform(self) -> Platform:
        """The platform file as it is now.

        Raises:
            InputError: it is wrong.
        """
        return load_platform(self._options.platform, is_loading_classes=True, devices=DEVICES)

    def new_boot(self) -> int:
        """A random number for something that begins."""
        return self._random.getrandbits(32)

    def is_beginning(self) -> bool:
        """Whether some component has not reached the state yet that its row asks for."""
        return self._onboard is None or self._onboard.is_beginning or self._keeper.is_beginning

    async def close(self) -> None:
        """Stops the components, then closes what they used."""
        self._link_watch.close()
        self._keeper.give_up_beginning()
        if self._onboard is not None:
            await self._onboard.stop(lambda text: self.say(Severity.WARNING, text))
            self._onboard.close()
        await self._keeper.end()
        if self._on_network is not None:
            self._on_network.close()
        self._clock_server.close()
        self._host_watch.close()
        self._herald.close()
        self._companion.close()
        if refused := self._companion.reasons.said:
            self.say(Severity.INFO, f"refused of other programs' stations: {counted(refused, 'request')}")
        self._autopilot.close()
        if self._modem is not None:
            self._modem.close()
        for station in self._stations:
            station.close()
        for routed in self._routed:
            routed.close()
            if self._onboard is not None:
                self.say(Severity.INFO, f"{routed.url}: {routed.condition().traffic.describe()}")
        for endpoint in self._endpoints:
            await endpoint.close()
        self._signing_memory.close()
        if self._log is not None:
            await self._log.close()
        self._readers.shutdown(cancel_futures=True)
        self._narrator.close()

    def say(self, severity: Severity, text: str) -> None:
        """Narrates on stderr."""
        if not self._options.is_quiet and severity <= Severity.INFO:
            self._narrator.say(f"onboard: {text}", severity)

    async def renew_network(self) -> None:
        """Reads the network file again; where it is wrong, everything stays as it is."""
        network = self._options.network
        if network is None or self._on_network is None:
            return
        self._host_watch.expect_renewal()
        try:
            member = await renew(self.exchange, self._endpoint, self._platform, self._place.host, network, self._loop)
        except (InputError, Refused) as error:
            self.say(Severity.ERROR, f"{error}: the network stays as it was")
            return
        except Gloc3Error as error:
            self.say(Severity.ERROR, f"{error}: nobody else is reached")
            return
        self._on_network.roles = member.file.roles
        self.say(Severity.NOTICE, f"{network} is read again: {counted(len(member.file.others), 'other member')}")

    def _forged(self, station: str, reason: str) -> None:
        self._network_news.say(Severity.WARNING, f"a request of {station} is not taken: {reason}")

    def _autopilot_says(self, severity: Severity, text: str) -> None:
        """Tells what happens on the autopilot's link; what is narrated as an event is not narrated twice."""
        self._news.say(severity, text)
        if severity > Severity.WARNING:
            self.say(severity, text)

    def _keep(self, link: str, direction: Literal["in", "out"], frame: bytes) -> None:
        """Keeps a MAVLink frame, once there is a log."""
        if self._log is not None:
            self._log.keep(link, direction, frame)

    def _tell_stations(self, message: MavlinkMessage) -> None:
        for station in self._stations:
            station.send(message)

    def _system_restarted(self, system: int) -> None:
        self.say(Severity.NOTICE, f"MAVLink system {system} has restarted: its routes are learned anew")

    def _narrate(self, envelope: Envelope[Event]) -> None:
        event = envelope.payload
        if event.severity <= Severity.WARNING:
            self.say(event.severity, f"{envelope.source.component}: {event.text}")
            for line in event.details.splitlines():
                self.say(event.severity, f"    {line}")

    def _tell_from(self, severity: Severity) -> None:
        self._herald.least_severity = severity

    def _allow_writing(self, is_allowed: bool) -> None:
        self._may_write = is_allowed

    def _share(self) -> None:
        """Shares missions, logs and metadata with stations of others."""
        try:
            files = shared_files(self._out, self._logs, self._companion.metadata.files)
        except OSError as error:
            raise Refused(f"the folder {self._out} cannot be written: {error.strerror}") from error
        self._companion.share(files, lambda: self._may_write)

    def _open_log(self) -> Path:
        """Begins the next log of the folder; its file."""
        for folder in (self._out, self._logs):
            if folder.is_file():
                raise Refused(f"{folder} is a file, not a folder")
        try:
            for folder in (self._out, self._logs):
                folder.mkdir(parents=True, exist_ok=True)
            file = find_platform(self._options.platform).read_bytes()
            log = self._log = RunLog(
                LogFiles(self._logs, log_stem(self._platform, self._place)),
                self._options.log_limits,
                self._clock,
                self._topics,
                self.exchange.here,
                self._loop,
                {"platform": self._platform.platform},
                file,
                lambda: self._path.points_ned_m,
                self.say,
            )
        except OSError as error:
            raise Refused(f"{error.filename or self._logs} cannot be written: {error.strerror}") from error
        return log.path

    def _unfinished_logs(self) -> set[Path]:
        return set() if self._log is None else self._log.unfinished

    def _cut_log(self) -> None:
        if self._log is not None:
            self._log.cut()

    def _log_problem(self) -> str:
        return (self._log.problem if self._log is not None else "") or self._keeper.log_problem()

    def _sensor_conditions(self) -> list[SensorCondition]:
        return [*self._watch.conditions(), *self._keeper.child_sensors(), *self._host_watch.sensors()]

    def _order(self, process: str, lives: dict[str, str | None] | None) -> Order:
        """What a child process is told."""
        return Order(
            platform=self._options.platform,
            host=self._place.host,
            process=process,
            endpoint=self._endpoint,
            logs=str(self._logs),
            devices=self._options.devices,
            parent=os.getpid(),
            offset_s=0.0,
            log_limits=self._options.log_limits,
            lives=lives,
        )

    def _link_conditions(self) -> list[LinkCondition]:
        return [routed.condition() for routed in self._routed]

    def _signing(self, url: str, number: int, default: bytes | None) -> Signing | None:
        """What signs the link of this number, where there is a key."""
        file = parse_url(url).key
        key = read_signing_key(Path(file).expanduser()) if file else default
        return None if key is None else self._signing_memory.signing(key, number & 0xFF)

    async def _open_modem(self, url: str) -> None:
        """The acoustic modem, which carries nothing of the other links."""
        file = parse_url(url).key
        key = read_signing_key(Path(file).expanduser()) if file else None
        modem: list[AcousticLink] = []
        endpoint = await open_endpoint(url, self._loop, lambda data: modem[0].receive(data) if modem else None)
        self._endpoints.append(endpoint)
        boot = self._random.getrandbits(32)
        modem.append(AcousticLink(self._platform.platform, self.exchange, self._loop, boot, endpoint.send, key))
        self._modem = modem[0]

    async def _open_link(self, url: str, link: AutopilotLink | StationLink) -> None:
        is_to_stations = isinstance(link, StationLink)
        send = link.send if isinstance(link, StationLink) else link.send_message
        is_for_observers = is_to_stations and StationRole(parse_url(url).role) is StationRole.OBSERVER
        hear = None if is_for_observers else self._companion.attach(send, is_to_stations=is_to_stations)
        watch = RateWatch(self._autopilot.ask_streams_again, self._loop.time) if is_to_stations else None

        def listen(frames: list[Frame]) -> None:
            link.take(frames)
            if hear is not None:
                hear(frames)
            if watch is not None:
                watch.hear(frames)

        # What observers send reaches our own command interface alone, which tells looking from commanding.
        keeps: Callable[[Frame], bool] | None = (lambda _: True) if is_for_observers else None
        if is_to_stations and not is_for_observers and self._options.takes_plans:
            keeps = self._companion.keeps
        routed = RoutedLink(url, self._router, self._loop, listen, self._keep, link.signed_only, keeps)
        endpoint = await open_endpoint(url, self._loop, routed.receive)
        self._endpoints.append(endpoint)
        self._routed.append(routed)
        routed.open(endpoint)
        link.open(routed)

    def _devices(self, log: Path) -> dict[str, Any]:
        """What the components use; the pictures go to a folder of each log's own: `images`, `images-2`..."""
        return {
            **self._sources,
            "rig": self._rig,
            "autopilot": self._autopilot,
            "computer": self._computer,
            "pictures": PictureFolder(self._logs / log.stem.replace("log", "images", 1), self._rig),
            "site": Site(
                self._platform,
                RecordFile(self._out / "requests.journal"),
                RecordFile(self._out / "progress.state"),
                RecordFile(self._out / "events.store"),
                self._random.getrandbits(31),
                LogShelf(self._logs, self._unfinished_logs, self._cut_log, self._readers),
                start_of_computer(),
                ThreadPoolExecutor(1, "mission check"),
            ),
            "taps": ExchangeTaps(self.exchange, self._loop, self._platform.platform),
            "catalogue": Catalogue(self._platform, self._topics),
        }
