"""The onboard process in wall time: opens links and files, hosts the components, and stops cleanly."""

import asyncio
import faulthandler
import gc
import os
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from random import SystemRandom
from typing import TYPE_CHECKING, Any, Final

from gloc3.cli.narration import Narrator, is_journal, narrate
from gloc3.clock import Clock, utc_now
from gloc3.component.context import HostContext
from gloc3.component.host import ComponentHost
from gloc3.component.memory import MemoryReserve, is_out_of_memory
from gloc3.component.workers import take_real_time_priority
from gloc3.errors import Refused
from gloc3.exchange.base import Exchange
from gloc3.mavlink.transport.endpoints import Endpoint, open_endpoint, parse_url
from gloc3.messages.envelope import Severity
from gloc3.messages.readiness import SensorCondition
from gloc3.network.rights import Rights
from gloc3.platform.places import ProcessPlace, choose_host, clock_host, rows_at
from gloc3.platform.platform import Platform
from gloc3.platform.reader import find_platform, load_platform
from gloc3.terrain import open_terrain
from gloc3_onboard.assembly import VehicleSide, watch_sensors
from gloc3_onboard.companion.acoustic_link import ModemSettings
from gloc3_onboard.companion.cameras import cameras_of
from gloc3_onboard.hosts.other_processes import OtherProcesses
from gloc3_onboard.hosts.shared import SharedExchange, alone, check_member, open_shared
from gloc3_onboard.inputs import Attachment, Hosting, VehicleInputs, devices_of, open_sensors
from gloc3_onboard.process.computer import HostComputer
from gloc3_onboard.process.journal import SystemdJournal
from gloc3_onboard.process.options import ProcessOptions
from gloc3_onboard.process.process_storage import ProcessStorage, key_of
from gloc3_onboard.process.runner import HOST_DEVICES
from gloc3_onboard.process.vitals import VitalSigns
from gloc3_onboard.sensors.registry import SourceHost, is_interactive, sensor_kinds
from gloc3_onboard.service.manager import ServiceManager
from gloc3_onboard.service.service import SystemdService
from gloc3_onboard.video.streams import StreamedCamera, VideoAddress, VideoSource, VideoStreams, read_address

if TYPE_CHECKING:
    from gloc3.network.file import Membership

REAL_TIME_SWITCH_S: Final = 0.001
"""For so long, in seconds, another thread may keep the interpreter; Python's own choice is 5 ms.

Each thread that waits wakes up this often, so that with less they delay the one that is at work.
"""
DEVICES: Final = (*HOST_DEVICES, *sensor_kinds(), *(f"*_{sensor}" for sensor in sensor_kinds()))
"""What this host has; installed packages bring more."""


def _report_failure(options: ProcessOptions, _kind: str, text: str) -> None:
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
    member = None
    if options.network is not None:
        from gloc3.network.file import read_network  # with all of its cryptography

        member = read_network(options.network, utc_now())
    check_member(platform, host, member)
    if options.is_real_time:
        if host != clock_host(platform):
            raise Refused("--real-time is for the host with the autopilot: no other has its control path")
        with ThreadPoolExecutor(1) as trial:  # before anything begins
            trial.submit(take_real_time_priority).result()
    if member is not None and (warning := member.expiry(utc_now())):
        narrate(f"onboard: {warning}", Severity.WARNING)
    opened = partial(
        open_shared, platform, host, options.folder(platform), loop, partial(_report_failure, options), member
    )
    if host != clock_host(platform):
        from gloc3_onboard.hosts.host_process import HostOptions, run_host

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
        service = SystemdService(manager, process, loop)
        try:
            await process.open()
            await service.run()
        finally:
            await process.close()
            manager.close()
    return 0


class OnboardProcess:
    """The main process of the clock host: a vehicle's side with real links, sensors, files and other processes."""

    _is_exhausted = False
    """Whether memory was used up before all was open: no component can be stopped in order."""

    def __init__(
        self,
        options: ProcessOptions,
        platform: Platform,
        loop: asyncio.AbstractEventLoop,
        shared: SharedExchange | None = None,
        member: "Membership | None" = None,
    ) -> None:
        self._options, self._loop = options, loop
        shared = shared or alone()
        self.platform: Final = platform
        """The platform as started."""
        self.exchange: Final[Exchange] = shared.exchange
        """What the components say to each other."""
        self._random = SystemRandom()
        self._narrator = Narrator()
        self._endpoints: list[Endpoint] = []
        place = ProcessPlace(choose_host(platform, options.host))
        self._memory = MemoryReserve()
        loop.set_exception_handler(self._handle_failure)
        context = HostContext(
            platform.platform, self.exchange, Clock(loop), loop, shared.topics, self._random, memory=self._memory
        )._replace(is_real_time=options.is_real_time)
        self._storage = ProcessStorage(options, platform, place, context, self.narrate)
        self._rights = Rights(
            platform.platform,
            context.clock.utc_s,
            context.clock.now_s,
            None if member is None else member.rights,
            None if member is None else member.commanding,
            None if member is None else member.validity,
        )
        inputs = self._inputs(context)
        self.vehicle: Final = VehicleSide(inputs, options.autopilot)
        """Its parts."""
        self.vehicle.parts.add("terminal", self._narrator)
        self._rows = rows_at(platform, place)
        used, autopilot = devices_of(self._rows), self.vehicle.autopilot
        requested = [each for each in options.devices if is_interactive(platform, used, each)]
        folder = find_platform(options.platform).parent
        source_host = SourceHost(
            loop, folder, autopilot.telemetry.t_s_of_boot, autopilot.sensors, self.vehicle.autopilot_device
        )
        self._sensors = open_sensors(platform, used, requested, source_host, partial(self.narrate, Severity.WARNING))
        self._watch = watch_sensors(self.vehicle.parts, self._sensors, context.clock.now_s)
        self._others = OtherProcesses(options, inputs, shared, member, self.vehicle, self._watch.conditions)
        self._computer = self._host_computer(context)

    def _host_computer(self, context: HostContext) -> HostComputer:
        storage = self._storage
        links, sensors = self.vehicle.link_conditions, self._sensor_conditions
        return HostComputer(storage.logs, context.clock, self._log_problem, links, sensors, storage)

    def _inputs(self, context: HostContext) -> VehicleInputs:
        storage, options, name = self._storage, self._options, self.platform.platform
        return VehicleInputs(
            platform=self.platform,
            context=context,
            report=self.narrate,
            journal=SystemdJournal(f"gloc3-{name}") if is_journal() and not options.is_quiet else None,
            keep=storage.record_frame,
            vitals=VitalSigns(storage.logs).sample,
            sign=storage.sign,
            rights=self._rights,
            member_of=storage.member_of,
            system_id=options.system_id,
            accepts_plans=options.accepts_plans,
            terrain=open_terrain(options.terrain),
            video_url=read_address(options.video).url if options.video else lambda _camera: "",
        )

    async def open(self) -> None:
        """Opens the links and the log, and brings the components up."""
        try:
            await self._open_all()
        except (MemoryError, OSError, RuntimeError) as error:
            self._is_exhausted = is_out_of_memory(error)
            if self._is_exhausted:
                self._memory.release()
            raise

    async def _open_all(self) -> None:
        options, vehicle = self._options, self.vehicle
        await self._open(options.autopilot, vehicle.attach_autopilot(), pins_autopilot=True)
        for url in options.stations:
            await self._open(url, vehicle.attach_station(url), is_signed=options.signing_key is not None)
        if options.acoustic:
            member = self._storage.member_of(options.acoustic, 0)
            modem = vehicle.attach_modem(ModemSettings(key_of(options.acoustic), member))
            await self._open(options.acoustic, modem)
        await self._loop.run_in_executor(None, self._computer.measure)
        vehicle.path.on_change = self._storage.show_path
        storage = self._storage.open(lambda: vehicle.path.points_ned_m, self._sensors.rig, vehicle.parts)
        vehicle.share(self._storage.files(vehicle.companion.metadata.files))
        self._others.begin()
        if options.metrics:
            self._serve_metrics(options.metrics)
        if options.video:
            await self._serve_video(read_address(options.video))
        vehicle.host(
            self._sensors, self._computer, storage, Hosting(rows=self._rows, placeholders=self._others.placeholders)
        )
        vehicle.begin()
        count, name = len(self.platform.components), self.platform.platform
        self.narrate(Severity.INFO, f"{name}: {count} components; log in {self._storage.log}")

    def _serve_metrics(self, address: str) -> None:
        from gloc3_onboard.process.metrics import MetricsServer, is_loopback, parse_address

        server = MetricsServer(self.exchange, self.platform.platform, address)
        self.vehicle.parts.add("metrics", server, server.close)
        host = parse_address(address)[0]
        self.narrate(Severity.INFO, f"metrics: http://{host}:{server.port}/metrics")
        if not is_loopback(host):
            self.narrate(Severity.WARNING, f"metrics on {address} are open to everyone who reaches it")

    async def _serve_video(self, address: VideoAddress) -> None:
        moving = {name for row in self.platform.components for name in (row.settings or {}).get("on_gimbal", ())}
        entries = cameras_of(self.platform, self._sensors.rig.model, {})
        cameras = [StreamedCamera(entry.name, entry.model, entry.name not in moving) for entry in entries]
        names = [camera.name for camera in cameras]
        clock = Clock(self._loop)
        streams = VideoStreams(
            cameras, VideoSource(self.platform.platform, self.exchange, self._loop, clock.utc_offset)
        )
        self.vehicle.parts.add("video", streams, streams.close)
        await streams.open(address)
        self.narrate(Severity.INFO, f"video: {', '.join(map(address.url, names)) or 'this platform records no camera'}")
        if address.is_open:
            self.narrate(Severity.WARNING, f"video on {address.host} is open to everyone who reaches it")

    async def _open(
        self, url: str, attachment: Attachment, *, is_signed: bool = False, pins_autopilot: bool = False
    ) -> None:
        endpoint = await open_endpoint(url, self._loop, attachment.receive, pins_autopilot=pins_autopilot)
        self._endpoints.append(endpoint)
        attachment.open(endpoint)
        if warning := parse_url(url).warning(is_signed=is_signed):
            self.narrate(Severity.WARNING, warning)

    @property
    def hosts(self) -> Mapping[str, ComponentHost]:
        """Its components, once it is open."""
        return {} if self.vehicle.onboard is None else self.vehicle.onboard.hosts

    def _handle_failure(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Handles what a callback of the loop raised; out of memory is told once, without tracebacks."""
        if not is_out_of_memory(context.get("exception")):
            loop.default_exception_handler(context)
        elif self._memory.release():
            self.narrate(Severity.CRITICAL, self._memory.text())

    def settle(self) -> None:
        """All components are up: nothing holds up the control path from now on that need not.

        What is loaded stays, so that no search for garbage goes through it. The loop has real-time priority only now,
        because what it makes while starting shall keep the priority of the process. Priority alone does not take the
        interpreter from another thread: that gives it up within this interval.
        """
        gc.freeze()
        if self._options.is_real_time:
            take_real_time_priority()
            sys.setswitchinterval(REAL_TIME_SWITCH_S)

    def read_platform(self) -> Platform:
        """The platform file as it is now.

        Raises:
            InputError: it is wrong.
        """
        return load_platform(self._options.platform, is_loading_classes=True, devices=DEVICES)

    def new_boot(self) -> int:
        """A random boot number."""
        return self._random.getrandbits(32)

    def is_beginning(self) -> bool:
        """Whether a component has not yet reached the state that its row demands."""
        onboard = self.vehicle.onboard
        return onboard is None or onboard.is_beginning or self._others.is_beginning

    async def close(self) -> None:
        """Stops the components, then closes their resources."""
        vehicle = self.vehicle
        self._others.give_up_beginning()
        if vehicle.onboard is not None and not self._is_exhausted:
            await vehicle.onboard.stop(partial(self.narrate, Severity.WARNING))
        await self._others.end()
        if vehicle.onboard is not None:
            for line in vehicle.traffic():
                self.narrate(Severity.INFO, line)
        vehicle.close()
        for endpoint in self._endpoints:
            await endpoint.close()
        await self._storage.close()
        self._narrator.close()

    async def renew_network(self) -> None:
        """Reads the network file again; where it is wrong, everything stays as it is."""
        await self._others.renew_network()

    def narrate(self, severity: Severity, text: str) -> None:
        """Prints on stderr."""
        if not self._options.is_quiet and severity <= Severity.INFO:
            self._narrator.narrate(f"onboard: {text}", severity)

    def _log_problem(self) -> str:
        return "; ".join(filter(None, (self._storage.problem, *self._others.log_problems())))

    def _sensor_conditions(self) -> list[SensorCondition]:
        return [*self._watch.conditions(), *self._others.sensors()]
