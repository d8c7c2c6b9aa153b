"""The life of the onboard process: up, reloaded when told to, and down again, with its manager told all along."""

import asyncio
import signal
from collections.abc import Mapping
from typing import Final, Protocol

from gloc3.clock import monotonic_s
from gloc3.component.host import ComponentHost
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import Severity
from gloc3.platform.platform import Platform
from gloc3_onboard.service.departure import Departure
from gloc3_onboard.service.manager import ServiceManager
from gloc3_onboard.service.reload import PlatformReload
from gloc3_onboard.service.report import ServiceReport

STOPS: Final = (signal.SIGINT, signal.SIGTERM)


class Process(Protocol):
    """What the service is made of."""

    @property
    def exchange(self) -> Exchange:
        """What its components say to each other."""

    @property
    def platform(self) -> Platform:
        """Which it is, as it was begun."""

    @property
    def hosts(self) -> Mapping[str, ComponentHost]:
        """Its components."""

    def is_beginning(self) -> bool:
        """Whether some component is still being brought up."""

    def read_platform(self) -> Platform:
        """The platform file as it is now; raises `InputError` where it is wrong."""

    async def renew_network(self) -> None:
        """Reads the network file again."""

    def new_boot(self) -> int:
        """A random number for something that begins."""

    def say(self, severity: Severity, text: str) -> None:
        """Narrates."""


class Service:
    """Takes the signals from its making on: SIGTERM and SIGINT end the process, SIGHUP has its files read again."""

    def __init__(self, manager: ServiceManager, process: Process, loop: asyncio.AbstractEventLoop) -> None:
        self._manager, self._process, self._loop = manager, process, loop
        self._stopped, self._hurried, self._reload = asyncio.Event(), asyncio.Event(), asyncio.Event()
        for number in STOPS:
            loop.add_signal_handler(number, self._stop)
        loop.add_signal_handler(signal.SIGHUP, self._reload.set)

    async def run(self) -> None:
        """Runs until it is told to end, and has landed where that is the policy."""
        manager, process = self._manager, self._process
        report = ServiceReport(manager, process.exchange, process.platform.platform, process.is_beginning)
        departure = Departure(
            process.exchange, process.platform, self._loop, process.new_boot(), manager.extend, process.say
        )
        reload = PlatformReload(
            process.platform,
            process.read_platform,
            process.hosts,
            process.exchange,
            self._loop,
            process.new_boot(),
            lambda: departure.is_at_rest,
            process.say,
        )
        reloads = self._loop.create_task(self._read_again(reload))
        try:
            await self._stopped.wait()
            manager.stopping()
            report.end("stopping")
            process.say(Severity.NOTICE, "stopping")
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
