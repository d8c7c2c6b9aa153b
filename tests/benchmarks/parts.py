"""Costs of the parts: a component's cycle, local delivery, the codec, the log."""

import asyncio
import io
import time
from collections.abc import Callable, Mapping, Sequence
from random import Random
from typing import Final

from gloc3.clock import Clock, run_virtual
from gloc3.component.component import DataProcessor
from gloc3.component.context import HostContext
from gloc3.component.deployment import ComponentRow
from gloc3.component.host import ComponentHost
from gloc3.component.ports import Inbox, Input, Output, Result
from gloc3.component.settings import NoSettings
from gloc3.exchange import LocalExchange, Publisher
from gloc3.log.record import Recorder
from gloc3.mavlink import codec
from gloc3.messages.topics import TopicTable
from gloc3.messages.vehicle import HeightAboveGround, Pose

REPEATS = 5


class Passer(DataProcessor[NoSettings]):
    """One input, one output: the least that a component can do."""

    height = Input(HeightAboveGround)
    pose = Output(Pose)

    def work(self, now_s: float, inbox: Inbox) -> Sequence[Result]:
        """Reports a pose."""
        return [POSE]


POSE = Pose(position_ned_m=(1.0, 2.0, -3.0), velocity_ned_m_s=(0.1, 0.0, 0.0), ned_from_frd=(1.0, 0.0, 0.0, 0.0))
HEIGHT = HeightAboveGround(height_m=1.0, is_valid=True)


def best_us(work: Callable[[], int]) -> float:
    """The best of some repeats, in microseconds of processor time for one of the things that `work` counts."""
    best = float("inf")
    for _ in range(REPEATS):
        begin_s = time.process_time()
        count = work()
        best = min(best, (time.process_time() - begin_s) / count)
    return best * 1e6


def yardstick() -> int:
    """A fixed piece of plain Python, to compare machines and moments by."""
    total = 0
    for number in range(1_000_000):
        total += number & 3
    return 1_000_000 if total else 1


def cycles() -> int:
    """Hosted cycles in virtual time, timer and publishing included."""

    async def main() -> int:
        loop = asyncio.get_running_loop()
        exchange = LocalExchange()
        context = HostContext("p", exchange, Clock(loop), loop, TopicTable(), Random(1))
        row = ComponentRow(name="passer", class_name="x:y", rate_hz=100.0)
        host = ComponentHost(row, Passer, context)
        host.begin()
        await asyncio.sleep(200.0)
        return host.status().cycles

    return run_virtual(main())


def deliveries() -> int:
    """Publishing to two subscribers in one process."""
    exchange = LocalExchange()
    used: list[float] = []
    for _ in range(2):
        exchange.subscribe("p/height", lambda envelope: used.append(envelope.t_s))
    publisher = Publisher(exchange, "p", "c", 1)
    for number in range(50_000):
        publisher.publish("p/height", HEIGHT, float(number))
    return len(used) // 2


def frames() -> int:
    """MAVLink messages made, encoded, found in a datagram again, and decoded."""
    encoder, parser = codec.Encoder(1, 1), codec.Parser(is_datagram=True)
    for number in range(20_000):
        message = codec.message("ATTITUDE_QUATERNION", time_boot_ms=number, q1=1.0, rollspeed=0.1)
        for frame in parser.receive(encoder.encode(message)):
            frame.decode()
    return 20_000


def records() -> int:
    """Poses logged, with the JSON of Foxglove's schema, compressed."""

    async def main() -> int:
        loop = asyncio.get_running_loop()
        recorder = Recorder(io.BytesIO(), Clock(loop), TopicTable.installed(), {})
        exchange = LocalExchange()
        recorder.attach(exchange)
        publisher = Publisher(exchange, "p", "pose", 1)
        for number in range(20_000):
            publisher.publish("p/pose", POSE, float(number), "ned")
        recorder.close()
        return 20_000

    return run_virtual(main())


FIGURES: Final[Mapping[str, Callable[[], int]]] = {
    "a hosted cycle with one output": cycles,
    "local delivery to 2 subscribers": deliveries,
    "a MAVLink message, encoded and decoded": frames,
    "a pose in the log": records,
}
"""What is measured: each works, and returns how many it has done."""


def run() -> list[str]:
    """The costs, and each as a multiple of a million steps of a plain Python loop's step."""
    unit = best_us(yardstick)
    lines = [f"a step of a plain Python loop            {unit * 1000:8.1f} ns"]
    for name, work in FIGURES.items():
        cost = best_us(work)
        lines.append(f"{name:<40} {cost:8.2f} us   {cost / unit:6.0f} steps")
    return lines
