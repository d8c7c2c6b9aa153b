"""The onboard companion process: hosts the components of a platform and brings them up and down."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from random import Random
from typing import Any, Final, Protocol

from gloc3.clock import Clock
from gloc3.component.component import Component
from gloc3.component.context import HostContext
from gloc3.component.deployment import ComponentRow
from gloc3.component.host import ComponentHost
from gloc3.component.lci import Command, State
from gloc3.component.supervision import LciRequest, Step, Supervision
from gloc3.errors import Gloc3Error
from gloc3.exchange import Publisher, request
from gloc3.exchange.base import Exchange
from gloc3.messages.envelope import CommandReply, CommandRequest, ComponentStatus, Envelope, Kind
from gloc3.messages.topics import TopicTable
from gloc3.platform.platform import Platform

HOST_DEVICES: Final = (
    "autopilot",
    "catalogue",
    "computer",
    "gimbal",
    "known_map",
    "memory",
    "pictures",
    "rig",
    "site",
    "taps",
)
"""The devices that every host gives to the components, besides its sensors; a platform's rows are checked against them."""
STOP_TIMEOUT_S: Final = 6.0
"""How long a component may take to leave."""
STOP_PATIENCE_S: Final = 5.0
"""Time for which a component that refuses to leave is asked again, s; an autopilot changes its mode within a second, or
not at all."""
RETRY_S: Final = 0.2
LEAVES: Final = {Kind.COMMAND_INTERFACE: 0, Kind.DRIVER: 1}
"""In which order kinds of components leave; the others follow in the order of the file."""

Create = Callable[[ComponentRow, Mapping[str, Any]], Component[Any]]
"""Creates the component of a row from the host's devices."""


class ServiceSupervisor:
    """Supervises the command interfaces among some hosts, by their rows' `on_fault`.

    Args:
        hosts: component hosts of the process.
        context: shared by them.
    """

    def __init__(self, hosts: list[ComponentHost], context: HostContext) -> None:
        rows = [host.row for host in hosts if host.status().kind is Kind.COMMAND_INTERFACE]
        self._loop: Final = context.loop
        self._base: Final = f"{context.platform}/components/"
        self._publisher = Publisher(
            context.exchange, context.platform, "service_supervisor", context.random.getrandbits(32)
        )
        self._supervision = Supervision(rows, f"service-{context.loop.time():.3f}")
        self._timer: asyncio.TimerHandle | None = None
        self._unsubscribes = [
            unsubscribe
            for row in rows
            for unsubscribe in (
                context.exchange.subscribe(f"{self._base}{row.name}/status", self._receive_status),
                context.exchange.subscribe(f"{self._base}{row.name}/reply", self._receive_reply),
            )
        ]

    def close(self) -> None:
        """Looks after nothing any more."""
        for unsubscribe in self._unsubscribes:
            unsubscribe()
        self._unsubscribes.clear()
        if self._timer is not None:
            self._timer.cancel()

    def _receive_status(self, envelope: Envelope[Any]) -> None:
        if isinstance(envelope.payload, ComponentStatus):
            self._follow(self._supervision.receive_status(envelope.payload, self._loop.time()))

    def _receive_reply(self, envelope: Envelope[Any]) -> None:
        if isinstance(envelope.payload, CommandReply):
            self._follow(self._supervision.receive_reply(envelope.payload, self._loop.time()))

    def _tick(self) -> None:
        self._timer = None
        self._follow(self._supervision.tick(self._loop.time()))

    def _follow(self, steps: list[Step]) -> None:
        now_s = self._loop.time()
        for step in steps:
            if isinstance(step, LciRequest):  # of a verdict nobody is left to hear: the autopilot holds
                self._publisher.publish(f"{self._base}{step.component}/command", step.request, now_s)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        next_s = self._supervision.next_tick_s()
        if next_s is not None:
            self._timer = self._loop.call_at(next_s, self._tick)


class HostMember(Protocol):
    """A component of this host, in whichever of its processes."""

    @property
    def row(self) -> ComponentRow:
        """Its row of the platform file."""

    @property
    def kind(self) -> Kind:
        """The type of component."""

    @property
    def state(self) -> State | None:
        """The state; None is *absent*."""


class Onboard:
    """The components of one process of a platform; a host's main process also manages those of its child processes.

    Args:
        platform: the platform file.
        context: shared by the hosts.
        devices: by name, as the rows refer to them.
        create: creates the component of a row.
        rows: rows of this process; None for all.
        placeholders: components of child processes.
    """

    def __init__(
        self,
        platform: Platform,
        context: HostContext,
        devices: Mapping[str, Any],
        create: Create = ComponentRow.create,
        rows: Sequence[ComponentRow] | None = None,
        placeholders: Sequence[HostMember] = (),
    ) -> None:
        self.platform = platform
        self.context = context
        self.devices: Final = devices
        self.hosts: Final = {
            row.name: ComponentHost(row, partial(create, row, devices), context)
            for row in (platform.components if rows is None else rows)
        }
        self._placeholders = tuple(placeholders)
        self._supervisor: ServiceSupervisor | None = None

    @classmethod
    def of(
        cls,
        platform: Platform,
        loop: asyncio.AbstractEventLoop,
        exchange: Exchange,
        topics: TopicTable,
        random: Random,
        devices: Mapping[str, Any],
    ) -> "Onboard":
        """An onboard process without modelled costs."""
        return cls(platform, HostContext(platform.platform, exchange, Clock(loop), loop, topics, random), devices)

    def begin(self) -> None:
        """Brings every component to the state that its row demands, in the order of the file."""
        self._supervisor = ServiceSupervisor(list(self.hosts.values()), self.context)
        for host in self.hosts.values():
            host.begin()

    def begin_again(self, lives: Mapping[str, str | None]) -> None:
        """Has every component back after the process has ended: faulty with that cause, or absent (None)."""
        for name, host in self.hosts.items():
            host.begin_again(lives.get(name))

    @property
    def is_beginning(self) -> bool:
        """Whether some component has not reached that state yet."""
        return any(host.is_beginning for host in self.hosts.values())

    async def stop(self, report: Callable[[str], None] = lambda _: None) -> None:
        """Shuts down every component by command.

        The command interface leaves first, so that no more requests come and the mission's progress is kept; then the
        drivers, while the inputs that show their devices safe still work; then the chain from start to end. A driver
        that refuses because its device is not safe yet is asked again for a while.

        Args:
            report: called with messages for people.
        """
        self._dismiss_supervisor()
        context = self.context
        publisher = Publisher(context.exchange, context.platform, "runner", context.random.getrandbits(32))
        members: list[HostMember] = [*self.hosts.values(), *self._placeholders]
        for member in sorted(members, key=lambda member: LEAVES.get(member.kind, len(LEAVES))):
            reason = await self._shut_down(member, publisher)
            if reason:
                report(f"{member.row.name} has not left: {reason}")

    async def _shut_down(self, host: HostMember, publisher: Publisher) -> str:
        """Has one component leave; returns why it has not, or an empty text."""
        context = self.context
        until_s = context.loop.time() + STOP_PATIENCE_S
        topic = f"{context.platform}/components/{host.row.name}/command"
        requested = 0
        while host.state is not None:
            requested += 1
            message = CommandRequest(request_id=f"stop-{requested}", command=Command.SHUTDOWN)
            try:
                reply = await request(context.exchange, publisher, topic, message, STOP_TIMEOUT_S)
            except TimeoutError:  # a component that hangs does not keep the others
                return "it does not answer"
            if reply.is_accepted:
                break
            if context.loop.time() >= until_s:
                return str(reply.reason)
            await asyncio.sleep(RETRY_S)
        return ""

    def close(self) -> None:
        """Ends without ceremony."""
        self._dismiss_supervisor()
        for host in self.hosts.values():
            host.close()

    def _dismiss_supervisor(self) -> None:
        if self._supervisor is not None:
            self._supervisor.close()
            self._supervisor = None

    def state(self, name: str) -> State | None:
        """The state of a component.

        Raises:
            Gloc3Error: there is none of that name.
        """
        if name not in self.hosts:
            raise Gloc3Error(f"platform {self.platform.platform} has no component {name!r}")
        return self.hosts[name].state
