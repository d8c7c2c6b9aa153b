"""Runs microservices without I/O on one of the station's links, and lets coroutines await their results."""

import asyncio
from collections.abc import Callable, Iterable
from typing import Any, Final, Protocol

from gloc3.errors import Refused
from gloc3.exchange.base import Unsubscribe
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.service import Microservice


class Wire(Protocol):
    """The part of a link that a service needs; `gloc3_groundstation.links.links.Link` is one."""

    @property
    def own(self) -> Address:
        """Address of the station there."""

    def send(self, message: MavlinkMessage) -> None:
        """Sends a message of the station's."""

    def listen(self, listener: Callable[[Frame], None]) -> Unsubscribe:
        """Registers a listener for all received frames."""


class _Waiter:
    """A coroutine that waits for something."""

    __slots__ = ("ended", "is_over", "poll")

    def __init__(self, is_over: Callable[[], bool], poll: Callable[[], None] | None, ended: asyncio.Future[None]):
        self.is_over, self.poll, self.ended = is_over, poll, ended


class Machines:
    """Services of the station for one vehicle.

    Args:
        wire: the link.
        system: the vehicle's MAVLink system; frames of other systems are ignored.
        services: those to run.
        received: called with every frame of the vehicle, after the services.
    """

    def __init__(
        self,
        wire: Wire,
        system: int,
        services: Iterable[Microservice[Any]],
        *,
        received: Callable[[Frame, float], None] | None = None,
    ) -> None:
        self.loop: Final = asyncio.get_running_loop()
        self._wire = wire
        self._system = system
        self._services = list(services)
        self._node = MavlinkComponent(wire.own, self._services)
        self._received = received
        self._waiters: list[_Waiter] = []
        self._on_event: list[Callable[[Any], None]] = []
        self._timer: asyncio.TimerHandle | None = None
        self._is_open = True
        self._unlisten = wire.listen(self._receive_frame)
        self.settle()

    @property
    def now_s(self) -> float:
        """The station's time."""
        return self.loop.time()

    def on_event(self, listener: Callable[[Any], None]) -> None:
        """Registers a listener for all events of the services."""
        self._on_event.append(listener)

    async def until(self, is_over: Callable[[], bool], poll: Callable[[], None] | None = None) -> None:
        """Waits for a condition; call it directly after a request to a service.

        Args:
            is_over: the condition.
            poll: called whenever something may have changed, for instance to report progress.

        Raises:
            Refused: the services are closed meanwhile.
        """
        if not self._is_open:
            raise Refused("the services of this vehicle are closed")
        waiter = _Waiter(is_over, poll, self.loop.create_future())
        self._waiters.append(waiter)
        try:
            self.settle()
            await waiter.ended
        finally:
            self._waiters.remove(waiter)
            if self._is_open:
                self.settle()

    def settle(self) -> None:
        """Sends pending messages, reports events, and sets the timer."""
        if not self._is_open:
            return
        for service in self._services:
            for event in service.events():
                for listener in self._on_event:
                    listener(event)
        for message in self._node.outgoing():
            self._wire.send(message)
        for waiter in tuple(self._waiters):
            if waiter.poll is not None:
                waiter.poll()
            if waiter.is_over() and not waiter.ended.done():
                waiter.ended.set_result(None)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        next_s = self._node.next_tick_s()
        if next_s is not None:
            self._timer = self.loop.call_at(max(next_s, self.now_s + 1e-3), self._tick)

    def close(self) -> None:
        """Stops sending and receiving; waiting callers are refused."""
        if not self._is_open:
            return
        self._is_open = False
        self._unlisten()
        if self._timer is not None:
            self._timer.cancel()
        for waiter in self._waiters:
            if not waiter.ended.done():
                waiter.ended.set_exception(Refused("the services of this vehicle are closed"))

    def _receive_frame(self, frame: Frame) -> None:
        if frame.system != self._system:
            return
        now_s = self.now_s
        is_accepted = self._node.receive(frame, now_s)
        if self._received is not None:
            self._received(frame, now_s)
        if is_accepted:
            self.settle()

    def _tick(self) -> None:
        self._timer = None
        self._node.tick(self.now_s)
        self.settle()
