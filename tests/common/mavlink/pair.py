"""Two MAVLink components on a lossy link in virtual time: a test wires services to both and lets time run."""

import random
from collections.abc import Callable, Sequence
from typing import Any

from tests.node_runner import NodeRunner

from gloc3.mavlink.message import Address
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.service import Microservice
from gloc3.mavlink.transport.memory import PERFECT, Conditions, MemoryLink

from .queue_loop import QueueLoop

VEHICLE = Address(1, 1)
STATION = Address(255, 190)


class Pair:
    """A vehicle (1/1) and a station (255/190)."""

    def __init__(self, seed: int = 1, conditions: Conditions = PERFECT) -> None:
        self.loop = QueueLoop()
        self.link = MemoryLink(self.loop, random.Random(seed), conditions)
        self.vehicle = NodeRunner(MavlinkComponent(VEHICLE), self.loop, self.link.a.send)
        self.station = NodeRunner(MavlinkComponent(STATION), self.loop, self.link.b.send)
        self.link.a.on_data = self.vehicle.on_data
        self.link.b.on_data = self.station.on_data

    @property
    def now_s(self) -> float:
        return self.loop.now_s

    def add(self, vehicle: Sequence[Microservice[Any]], station: Sequence[Microservice[Any]]) -> None:
        for runner, services in ((self.vehicle, vehicle), (self.station, station)):
            for service in services:
                runner.node.add(service)

    def run(self, for_s: float, is_done: Callable[[], bool] = lambda: False) -> None:
        """Lets time run, until something is so or for some seconds."""
        until_s = self.loop.now_s + for_s
        self.vehicle.settle()
        self.station.settle()
        self.loop.run(until_s, is_done)
