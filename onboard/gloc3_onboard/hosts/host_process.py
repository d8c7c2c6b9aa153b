"""The main process of a host that is not the clock host: it keeps the platform's time, and is led from the clock host."""

import asyncio
import os
import signal
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from functools import partial
from pathlib import Path
from typing import Final

from gloc3.cli.narration import Narrator
from gloc3.clock import monotonic_s
from gloc3.component.host import ComponentHost
from gloc3.component.hosted import HUNG
from gloc3.component.lci import State
from gloc3.errors import Gloc3Error, InputError, Misuse, Refused
from gloc3.messages.envelope import Envelope, Severity
from gloc3.messages.summaries import VehicleSummary
from gloc3.network.file import Membership
from gloc3.network.spreading import PASSED_ON_S, RevocationSpreader
from gloc3.platform.places import ProcessPlace, clock_host
from gloc3.platform.platform import Platform
from gloc3_onboard.hosts.host_agent import ClockState, HostAgent
from gloc3_onboard.hosts.host_clock import STEP_S, HostClock
from gloc3_onboard.hosts.loop import PlatformLoop
from gloc3_onboard.hosts.node import HostNode, NodeOptions
from gloc3_onboard.hosts.offset import OffsetEstimate
from gloc3_onboard.hosts.pipe import ChildSetup
from gloc3_onboard.hosts.shared import SharedExchange, renew, reread
from gloc3_onboard.process.event_narration import EventNarration
from gloc3_onboard.process.runner import HostMember
from gloc3_onboard.service.manager import ServiceManager
from gloc3_onboard.service.status import ServiceStatus

REMIND_S: Final = 10.0
"""Period of the reminder that the clock host is missing, s."""
POLL_S: Final = 0.1
ALIVE_S: Final = 1.0
VEHICLE_S: Final = 3.0
"""Age at which news of the vehicle are stale, s; they come twice a second."""

Open = Callable[[], AbstractContextManager[SharedExchange]]


class HostOptions(NodeOptions, frozen=True, kw_only=True):
    """Options of a host."""

    is_quiet: bool = False
    network: Path | None = None
    """Network file; reloaded on SIGHUP."""


async def run_host(options: HostOptions, platform: Platform, host: str, opened: Open, manager: ServiceManager) -> None:
    """Runs a host's share until a signal; restarts it when the clock host's time has jumped.

    Args:
        options: options of the host.
        platform: the platform.
        host: name of this host.
        opened: opens the exchange.
        manager: the service manager.

    Raises:
        Gloc3Error: the exchange, a source or the log cannot be opened.
    """
    loop = asyncio.get_running_loop()
    if not isinstance(loop, PlatformLoop):
        raise Misuse("a host beside the clock host needs a loop with the platform's time")
    stopped = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stopped.set)
    loop.add_signal_handler(signal.SIGHUP, lambda: None)  # there is nothing to be read again yet
    narrator = Narrator()

    def report(severity: Severity, text: str) -> None:
        if not options.is_quiet and severity <= Severity.INFO:
            narrator.narrate(f"{host}: {text}", severity)

    try:
        while not stopped.is_set():
            manager.status(f"waiting for {clock_host(platform)}, whose clock is the platform's time")
            offset_s = await _first_offset(platform, host, opened, stopped, manager, report)
            if offset_s is None:
                break
            loop.step(offset_s)
            with opened() as shared:
                life = HostProcess(options, platform, host, shared, loop, manager, report)
                await life.run(stopped)
    finally:
        narrator.close()


async def _first_offset(
    platform: Platform,
    host: str,
    opened: Open,
    stopped: asyncio.Event,
    manager: ServiceManager,
    report: Callable[[Severity, str], None],
) -> float | None:
    """Requests the clock host's time until the offset is known, with nothing else scheduled; None when stopped."""
    loop = asyncio.get_running_loop()
    known: list[OffsetEstimate] = []
    with opened() as shared:
        clock = HostClock(shared.exchange, platform.platform, host, loop, known.append)
        try:
            views = 0
            while not clock.has_settled:
                with suppress(TimeoutError):
                    async with asyncio.timeout(POLL_S):
                        await stopped.wait()
                        return None
                views += 1
                if views % round(REMIND_S / POLL_S) == 0:
                    manager.extend(3.0 * REMIND_S)
                    report(Severity.WARNING, f"{clock_host(platform)} does not answer: it provides the platform's time")
                    manager.extend(3.0 * REMIND_S)
        finally:
            clock.close()
    best = known[-1]
    report(
        Severity.INFO,
        f"the platform's time is {best.offset_s:+.3f} s from this computer's, to within {best.bound_s * 1e3:.1f} ms",
    )
    return best.offset_s


class HostProcess:
    """A host while its time is valid: until it is stopped, or the time has jumped."""

    def __init__(
        self,
        options: HostOptions,
        platform: Platform,
        host: str,
        shared: SharedExchange,
        loop: PlatformLoop,
        manager: ServiceManager,
        report: Callable[[Severity, str], None],
    ) -> None:
        self._options, self._platform, self._host, self._shared = options, platform, host, shared
        self._loop, self._manager, self._report = loop, manager, report
        self._jumped = asyncio.Event()
        self._node = HostNode(platform, options, ProcessPlace(host), shared.exchange, loop, shared.topics, report)
        self._clock = HostClock(shared.exchange, platform.platform, host, loop, self._follow)
        self._agent = HostAgent(
            platform,
            host,
            self._node.context,
            self._order,
            lambda text: report(Severity.WARNING, text),
            clock=self._clock_state,
            sensors=self._node.sensors,
            log_problem=lambda: self._node.log_problem,
        )
        names = [row.name for row in (*self._node.rows, *(placeholder.row for placeholder in self._agent.placeholders))]
        self._narration = EventNarration(shared.exchange.here, platform.platform, names, report)
        self._reload = asyncio.Event()
        """The network file has to be read again."""
        self._spreader: RevocationSpreader | None = None
        if shared.member is not None:
            random = self._node.context.random
            warn = partial(report, Severity.WARNING)
            self._spreader = RevocationSpreader(shared.exchange, loop, random, shared.member, self._adopt_list, warn)
        self._vehicle: VehicleSummary | None = None
        self._vehicle_s = 0.0
        self._unsubscribe = shared.exchange.subscribe(f"{platform.platform}/ci/vehicle", self._receive_vehicle)

    async def run(self, stopped: asyncio.Event) -> None:
        """Runs the components until the process is stopped or the clock host's time jumps."""
        self._agent.begin()
        onboard = self._node.make(self._agent.placeholders)
        onboard.begin()
        names = [row.name for row in (*self._node.rows, *(placeholder.row for placeholder in self._agent.placeholders))]
        self._report(Severity.INFO, f"{self._platform.platform}: {len(names)} components; log in {self._node.log}")
        tasks = [self._loop.create_task(self._feed()), self._loop.create_task(self._renew_on_request())]
        waits = [self._loop.create_task(event.wait()) for event in (stopped, self._jumped)]
        try:
            await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
            if stopped.is_set():
                self._manager.stopping()
                self._report(Severity.NOTICE, "stopping")
            else:
                self._report(Severity.WARNING, "the platform's time has jumped: all components restart")
        finally:
            for task in (*tasks, *waits):
                task.cancel()
            self._agent.give_up_beginning()
            await onboard.stop(lambda text: self._report(Severity.WARNING, text))
            await self._agent.end()
            self._unsubscribe()
            self._clock.close()
            if self._spreader is not None:
                self._spreader.close()
            self._narration.close()
            await self._node.close()

    async def _renew_on_request(self) -> None:
        """Reloads the network file on SIGHUP, and after a newer list of revoked members."""
        reload, network, spreader = self._reload, self._options.network, self._spreader
        self._loop.add_signal_handler(signal.SIGHUP, reload.set)
        while True:
            await reload.wait()
            reload.clear()
            self._manager.reloading(monotonic_s())
            if network is not None and spreader is not None:
                try:
                    self._agent.announce_renewal()
                    await asyncio.sleep(POLL_S)  # so that nobody notices the end before what is said of it
                    member = await reread(self._platform, self._host, network, self._loop, spreader.newest)
                    await renew(self._shared.exchange, self._shared.endpoint, member)
                    spreader.renew(member)
                    self._report(Severity.NOTICE, f"{network} is reloaded")
                except (InputError, Refused) as error:
                    self._report(Severity.ERROR, f"{error}: the network is unchanged")
                except Gloc3Error as error:
                    self._report(Severity.ERROR, f"{error}: other hosts are not reachable")
            self._manager.ready()

    def _adopt_list(self, _: Membership, *, is_anyone_out: bool) -> None:
        if is_anyone_out:
            self._loop.call_later(PASSED_ON_S, self._reload.set)

    async def _feed(self) -> None:
        """Feeds the service manager's watchdog, unless a required component here hangs."""
        is_ready = False
        while True:
            await asyncio.sleep(ALIVE_S)
            onboard = self._node.onboard
            assert onboard is not None
            if not is_ready and not onboard.is_beginning and not self._agent.is_beginning:
                is_ready = True
                self._manager.ready()
            hung = {host.row.name: host.errors.last_cause for host in onboard.hosts.values() if _hangs(host)}
            members: list[HostMember] = [*onboard.hosts.values(), *self._agent.placeholders]
            states = [(member.state, member.row.required) for member in members]
            place = f"{self._platform.platform}-{self._host}"
            self._manager.status(ServiceStatus.of_host(place, states, hung, self._vehicle_now()).text())
            if not hung:
                self._manager.alive()

    def _follow(self, known: OffsetEstimate) -> None:
        """Follows the clock host's time, or ends this life if that has jumped."""
        if abs(known.offset_s - self._loop.offset_s) > STEP_S + known.bound_s:
            self._jumped.set()
            return
        self._loop.steer(known.offset_s)
        self._agent.pass_time_on(known.offset_s)

    def _receive_vehicle(self, envelope: Envelope[VehicleSummary]) -> None:
        self._vehicle, self._vehicle_s = envelope.payload, self._loop.time()

    def _vehicle_now(self) -> VehicleSummary | None:
        """What the command server reports of the vehicle; None once that is stale."""
        return self._vehicle if self._loop.time() - self._vehicle_s <= VEHICLE_S else None

    def _clock_state(self) -> ClockState:
        known = self._clock.estimate()
        return ClockState(self._loop.offset_s, known.bound_s, known.round_trip_s, known.age_s)

    def _order(self, process: str, lives: dict[str, str | None] | None) -> ChildSetup:
        return ChildSetup(
            platform=self._options.platform,
            host=self._host,
            process=process,
            endpoint=self._shared.endpoint,
            logs=str(self._options.logs),
            devices=self._options.devices,
            parent=os.getpid(),
            offset_s=self._loop.offset_s,
            log_limits=self._options.log_limits,
            lives=lives,
        )


def _hangs(host: ComponentHost) -> bool:
    return host.row.required and host.state is State.FAULTY and host.errors.last_cause.startswith(HUNG)
