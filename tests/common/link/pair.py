"""Two MAVLink components on a lossy link in virtual time: a test wires services to both and lets time run."""

import random
from collections.abc import Callable, Sequence
from typing import Any

from gloc3.link import codec
from gloc3.link.memory import PERFECT, Conditions, MemoryEnd, MemoryLink
from gloc3.link.message import Address, MavlinkMessage
from gloc3.link.node import Node
from gloc3.link.service import Service

from .queue_loop import QueueLoop

VEHICLE = Address(1, 1)
STATION = Address(255, 190)


class Side:
    """A node with its encoder, parser and one end of the link, woken by the loop when it wants to be."""

    def __init__(self, own: Address, end: MemoryEnd, loop: QueueLoop) -> None:
        self.node = Node(own)
        self.heard: list[MavlinkMessage] = []
        self.is_listening = False
        self.after: Callable[[float], None] = lambda now_s: None
        """Called after each message and tick, as the program around the services would."""
        self._encoder = codec.Encoder(*own)
        self._parser = codec.Parser(is_datagram=True)
        self._end = end
        self._loop = loop
        self._wake_s: float | None = None
        end.on_data = self._on_data

    def settle(self) -> None:
        """Sends what is to be sent and sets the alarm."""
        self.after(self._loop.now_s)
        for message in self.node.outgoing():
            self._end.send(self._encoder.encode(message))
        next_s = self.node.next_tick_s()
        if next_s is not None and (self._wake_s is None or next_s < self._wake_s):
            self._wake_s = max(next_s, self._loop.now_s)
            self._loop.call_at(next_s, self._tick, self._wake_s)

    def send(self, message: MavlinkMessage) -> None:
        self._end.send(self._encoder.encode(message))

    def _on_data(self, data: bytes) -> None:
        for frame in self._parser.receive(data):
            if self.is_listening and (message := frame.decode()) is not None:
                self.heard.append(message)
            self.node.receive(frame, self._loop.now_s)
        self.settle()

    def _tick(self, wake_s: float) -> None:
        if wake_s != self._wake_s:
            return
        self._wake_s = None
        self.node.tick(self._loop.now_s)
        self.settle()


class Pair:
    """A vehicle (1/1) and a station (255/190)."""

    def __init__(self, seed: int = 1, conditions: Conditions = PERFECT) -> None:
        self.loop = QueueLoop()
        self.link = MemoryLink(self.loop, random.Random(seed), conditions)
        self.vehicle = Side(VEHICLE, self.link.a, self.loop)
        self.station = Side(STATION, self.link.b, self.loop)

    @property
    def now_s(self) -> float:
        return self.loop.now_s

    def add(self, vehicle: Sequence[Service[Any]], station: Sequence[Service[Any]]) -> None:
        for side, services in ((self.vehicle, vehicle), (self.station, station)):
            for service in services:
                side.node.add(service)

    def run(self, for_s: float, is_done: Callable[[], bool] = lambda: False) -> None:
        """Lets time run, until something is so or for some seconds."""
        until_s = self.loop.now_s + for_s
        self.vehicle.settle()
        self.station.settle()
        self.loop.run(until_s, is_done)
