"""A MAVLink component made of services: dispatches messages to them and collects their output."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from gloc3.mavlink import codec
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.parser import Frame
from gloc3.mavlink.service import Microservice, earliest


class MavlinkComponent:
    """Several services of one component, driven as one. Frames that no service handles are never decoded."""

    def __init__(self, own: Address, services: Iterable[Microservice[Any]] = ()) -> None:
        self.own = own
        self._services: list[Microservice[Any]] = []
        self._by_id: dict[int, tuple[Microservice[Any], ...]] = {}
        for service in services:
            self.add(service)

    def add(self, service: Microservice[Any]) -> None:
        """Takes one more service in."""
        self._services.append(service)
        for name in sorted(service.handles):
            number = codec.shape(name).id
            self._by_id[number] = (*self._by_id.get(number, ()), service)

    def receive(self, frame: Frame, now_s: float) -> bool:
        """Passes a frame to the services that handle it; our own frames that return are ignored.

        Returns:
            Whether a service handled it, and may have messages or events.
        """
        services = self._by_id.get(frame.message_id)
        if services is None or frame.sender == self.own:
            return False
        message = frame.decode()
        if message is None:
            return False
        for service in services:
            service.receive(message, frame.sender, now_s)
        return True

    def tick(self, now_s: float) -> None:
        """Runs what is due in each service."""
        for service in self._services:
            service.tick(now_s)

    def next_tick_s(self) -> float | None:
        """When the first of them has something to do."""
        return earliest(*(service.next_tick_s() for service in self._services))

    def outgoing(self) -> list[MavlinkMessage]:
        """What they all want to send; asking empties it."""
        return [message for service in self._services for message in service.outgoing()]
