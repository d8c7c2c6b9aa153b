"""Life cycle of the onboard process: start, reload and stop, reported to the service manager."""

import asyncio
import signal
from collections.abc import Callable, Mapping
from math import inf
from typing import Final, Protocol

from gloc3.clock import monotonic_s
from gloc3.component.host import ComponentHost
from gloc3.component.hosted import HUNG
from gloc3.component.lci import State
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import ComponentStatus, Envelope, Severity
from gloc3.messages.summaries import Health, MissionSummary, Summary, VehicleSummary
from gloc3.platform.platform import Platform
from gloc3_onboard.service.departure import Departure
from gloc3_onboard.service.manager import ServiceManager
from gloc3_onboard.service.reload import PlatformReload
from gloc3_onboard.service.status import ServiceStatus

STOPS: Final = (signal.SIGINT, signal.SIGTERM)


class Process(Protocol):
    """The process behind the service."""

    @property
    def exchange(self) -> Exchange:
        """What its components say to each other."""

    @property
    def platform(self) -> Platform:
        """The platform as started."""

    @property
    def hosts(self) -> Mapping[str, ComponentHost]:
        """Its components."""

    def is_beginning(self) -> bool:
        """Whether some component is still being brought up."""

    def settle(self) -> None:
        """Called once, when no component is starting any more."""

    def read_platform(self) -> Platform:
        """The platform file as it is now; raises `InputError` where it is wrong."""

    async def renew_network(self) -> None:
        """Reads the network file again."""

    def new_boot(self) -> int:
        """A random boot number."""

    def narrate(self, severity: Severity, text: str) -> None:
        """Narrates."""


class SystemdService:
    """Handles signals from its creation on: SIGTERM and SIGINT end the process, SIGHUP has its files read again."""

    def __init__(self, manager: ServiceManager, process: Process, loop: asyncio.AbstractEventLoop) -> None:
        self._manager, self._process, self._loop = manager, process, loop
        self._stopped, self._hurried, self._reload = asyncio.Event(), asyncio.Event(), asyncio.Event()
        for number in STOPS:
            loop.add_signal_handler(number, self._stop)
        loop.add_signal_handler(signal.SIGHUP, self._reload.set)

    async def run(self) -> None:
        """Runs until stopped, and landed where that is the policy."""
        manager, process = self._manager, self._process
        report = ServiceReport(
            manager, process.exchange, process.platform.platform, process.is_beginning, process.settle
        )
        departure = Departure(
            process.exchange, process.platform, self._loop, process.new_boot(), manager.extend, process.narrate
        )
        reload = PlatformReload(
            process.platform,
            process.read_platform,
            process.hosts,
            process.exchange,
            self._loop,
            process.new_boot(),
            lambda: departure.is_at_rest,
            process.narrate,
        )
        reloads = self._loop.create_task(self._read_again(reload))
        try:
            await self._stopped.wait()
            manager.stopping()
            report.end("stopping")
            process.narrate(Severity.NOTICE, "stopping")
            await departure.land(self._hurried)
        finally:
            reloads.cancel()
            for part in (reload, departure, report):
                part.close()

    def _stop(self) -> None:
        (self._hurried if self._stopped.is_set() else self._stopped).set()

    async def _read_again(self, reload: PlatformReload) -> None:
        while True:
            await self._reload.wait()
            self._reload.clear()
            self._manager.reloading(monotonic_s())
            await self._process.renew_network()
            await reload.read_again()
            self._manager.ready()


CONTACT_WITHIN_S: Final = 3.0
"""Time after start within which a component must report, s; later ones, such as on another host, are not waited for."""


class ServiceReport:
    """Reports to the manager from the summaries that also make the heartbeat; without them the watchdog starves.

    READY follows when no component is starting any more. Each summary feeds the watchdog, unless a required component
    hangs without a replacement: if that lasts, only a new process helps.

    Args:
        manager: the service manager.
        exchange: source of the summaries.
        platform: the platform.
        is_beginning: whether a component is still starting.
        settle: called once, when none is starting any more.
    """

    def __init__(
        self,
        manager: ServiceManager,
        exchange: Exchange,
        platform: str,
        is_beginning: Callable[[], bool],
        settle: Callable[[], None],
    ) -> None:
        self._manager, self._is_beginning, self._platform, self._settle = manager, is_beginning, platform, settle
        self._is_ready = self._is_ending = False
        self._begun_s = inf
        self._hung: dict[str, str] = {}
        """Required components that hang, with the cause."""
        self._in_charge: dict[str, str] = {}
        """Active standbys, to the component that they replace."""
        self._summary: Summary | None = None
        self._vehicle: VehicleSummary | None = None
        self._mission: MissionSummary | None = None
        self._unsubscribes = [
            exchange.subscribe(f"{platform}/ci/summary", self._receive_summary),
            exchange.subscribe(f"{platform}/ci/vehicle", self._receive_vehicle),
            exchange.subscribe(f"{platform}/ci/mission", self._receive_mission),
            exchange.subscribe(f"{platform}/components/*/status", self._receive_status),
        ]

    def end(self, text: str) -> None:
        """Reports that the process is stopping; the text is the status from now on."""
        self._is_ending = True
        self._manager.status(text)

    def close(self) -> None:
        """Tells nothing any more."""
        for unsubscribe in self._unsubscribes:
            unsubscribe()
        self._unsubscribes.clear()

    def _receive_status(self, envelope: Envelope[ComponentStatus]) -> None:
        status = envelope.payload
        if status.is_required and status.state is State.FAULTY and status.cause.startswith(HUNG):
            self._hung[status.name] = status.cause
        else:
            self._hung.pop(status.name, None)
        if status.standby_for:
            self._in_charge[status.name] = status.standby_for if status.state is State.WORKING else ""

    def _receive_vehicle(self, envelope: Envelope[VehicleSummary]) -> None:
        self._vehicle = envelope.payload

    def _receive_mission(self, envelope: Envelope[MissionSummary]) -> None:
        self._mission = envelope.payload

    def _receive_summary(self, envelope: Envelope[Summary]) -> None:
        self._summary = summary = envelope.payload
        if not self._is_ending:
            status = ServiceStatus.of(self._platform, summary, self._hung, self._vehicle, self._mission)
            self._manager.status(status.text())
        if not self._is_ready and not self._is_beginning():
            self._begun_s = min(self._begun_s, envelope.t_s)
            is_in_contact = all(list(Health)[line.state] is not Health.ABSENT for line in summary.lines)
            if is_in_contact or envelope.t_s - self._begun_s > CONTACT_WITHIN_S:
                self._is_ready = True
                self._settle()
                self._manager.ready()
        if set(self._hung) <= set(self._in_charge.values()):
            self._manager.alive()
