"""State shared by the hosts of one process."""

import asyncio
from collections.abc import Callable
from random import Random
from typing import NamedTuple
from zlib import crc32

from gloc3.clock import Clock
from gloc3.component.deployment import ComponentRow
from gloc3.component.memory import MemoryReserve
from gloc3.component.workers import InlineWorker, ThreadWorker, Worker, rate_priority
from gloc3.exchange.base import Exchange
from gloc3.messages.topics import TopicTable


class HostContext(NamedTuple):
    """State shared by the hosts of one process."""

    platform: str
    exchange: Exchange
    clock: Clock
    loop: asyncio.AbstractEventLoop
    topics: TopicTable
    random: Random
    """Draws boot numbers."""
    cycle_cost_s: Callable[[str, float], float] | None = None
    """Virtual time: cost of a cycle of the named component at a given time, by the fault model."""
    method_cost_s: Callable[[str, str, float], float] | None = None
    """Virtual time: cost of a command or function (component, its name, time), by the fault model."""
    memory: MemoryReserve | None = None
    """What is left for the others when memory is used up; None where it is not reserved."""

    is_real_time: bool = False
    """Whether the required components have real-time priority by rate, and the cycles of all are spread over their periods."""

    def phase(self, name: str) -> float:
        """By which share of its period a component's cycles come later.

        In real time the cycles of all are spread, so that those of one rate do not wait for one another.
        """
        return crc32(name.encode()) / 2**32 if self.is_real_time else 0.0

    def new_worker(self, row: ComponentRow) -> Worker:
        """A worker for one component."""
        if self.clock.is_virtual:
            return InlineWorker(self.loop)
        make_room = (lambda: False) if self.memory is None else self.memory.release
        priority = rate_priority(row.rate_hz or 1.0) if self.is_real_time and row.required else 0
        return ThreadWorker(self.loop, row.name, make_room, priority=priority)
