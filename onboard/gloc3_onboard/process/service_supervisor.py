"""Looks after the command interface: it supervises all other components, and this brings it up again when it fails."""

import asyncio
from typing import Any, Final

from gloc3.component.context import HostContext
from gloc3.component.host import ComponentHost
from gloc3.component.supervision import LciRequest, Step, Supervision
from gloc3.exchange import Publisher
from gloc3.messages.envelope import CommandReply, ComponentStatus, Envelope, Kind


class ServiceSupervisor:
    """Supervises the command interfaces among some hosts, by their rows' `on_fault`.

    Args:
        hosts: those of the process.
        context: what they share.
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
