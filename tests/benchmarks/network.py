"""The zenoh exchanger beside Zenoh itself, between two processes: delay, rate, pictures, and a robot's usual traffic.

Everything that is compared is open at the same time between the same two processes, and has its turn in each round, so
that a busy machine is as busy for all. Zenoh itself is used as anybody would: the same message through msgspec's codec,
decoded in Zenoh's callback, without envelope, loop, table of topics or counters.
"""

import asyncio
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from statistics import median, quantiles
from typing import Any, NamedTuple

import msgspec
import zenoh
from tests.benchmarks.parts import POSE, best_us, deliveries

from gloc3.exchange import Publisher
from gloc3.exchange.zenoh import ZenohExchange, open_exchange
from gloc3.exchange.zenoh_session import UNIX, ZenohEndpoints, configuration
from gloc3.messages.envelope import Envelope
from gloc3.messages.topics import TopicRow, TopicService, TopicTable
from gloc3.messages.vehicle import Image, Pose

ROUNDS = 5
PACED = 150
PACED_EVERY_S = 0.004
BURST = 3000
PICTURES = 40
PICTURE_EVERY_S = 0.015
FAST_PICTURES = 400
TOLD_EVERY = 2
"""After so many pictures the other end tells how far it is: seldom, since that costs time, too."""
LOST_S = 0.05
"""What has not come for so long is lost."""
TOPICS = 20
TOPIC_RATE_HZ = 100
USUAL_S = 2.0
NAMES = ("pose", "burst", "usual/*")
PICTURE = Image(camera="front", width=640, height=480, data=os.urandom(640 * 480))
RAW, LOOP, OURS, SHARED, ZENOHS, TCP = (
    *("zenoh", "zenoh to the loop", "gloc3"),
    *("shared memory", "zenoh's shared memory", "tcp"),
)
IN_FLIGHT = {SHARED: 8, ZENOHS: 8, TCP: 4}
"""So many pictures may be under way, as suits each: the queue of a link takes three."""


ZENOHS_SETTINGS = {
    "transport/shared_memory/enabled": True,
    "transport/shared_memory/mode": "init",
    "transport/shared_memory/transport_optimization/pool_size": 1 << 26,
}
"""Zenoh's own shared memory, made ready at once, with place for all pictures that are under way."""


class Wire(msgspec.Struct, array_like=True, frozen=True):
    """What Zenoh itself carries: the pose and when it was sent."""

    t_s: float
    position_ned_m: tuple[float, float, float]
    velocity_ned_m_s: tuple[float, float, float]
    ned_from_frd: tuple[float, float, float, float]


class Places(NamedTuple):
    """Where the sender listens."""

    raw: str
    ours: str
    shared: str
    zenohs: str
    tcp: str


class Heard(NamedTuple):
    """What came in a turn."""

    messages: int
    p50_us: float
    p99_us: float
    last_s: float
    cpu_s: float
    """Processor time of the receiving process."""


def topics() -> TopicTable:
    """The topics of the comparison."""
    table = TopicTable()
    table.add(
        {
            "pose": TopicRow(Pose, 20.0, service=TopicService.CONTROL),
            "burst": TopicRow(Pose, service=TopicService.REPORT),
            "camera/*": TopicRow(Image, 15.0, service=TopicService.BULK),
            "usual/*": TopicRow(Pose, 100.0, service=TopicService.STREAM),
            "credit": TopicRow(Pose, service=TopicService.COMMAND),
        }
    )
    return table


def places(folder: str) -> Places:
    """Free ports, and a socket in a folder."""
    found = []
    for _ in range(4):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            found.append(f"tcp/127.0.0.1:{probe.getsockname()[1]}")
    return Places(found[0], found[1], f"{UNIX}/{folder}/z", found[2], found[3])


def exchange_at(stack: ExitStack, name: str, node: ZenohEndpoints) -> ZenohExchange:
    """One end of what is compared, by its name."""
    loop, settings = asyncio.get_running_loop(), ZENOHS_SETTINGS if name == ZENOHS else None
    is_sharing = name not in (ZENOHS, TCP)
    return stack.enter_context(open_exchange(node, loop, topics(), settings=settings, is_sharing=is_sharing))


# --- the receiving process ---


class Receiver:
    """Notes when what arrives."""

    def __init__(self) -> None:
        self._delays_s: list[float] = []
        self._last_s = 0.0

    def note(self, sent_s: float) -> None:
        """Something came."""
        now_s = time.monotonic()
        self._delays_s.append(now_s - sent_s)
        self._last_s = now_s

    def take_raw(self, sample: zenoh.Sample) -> None:
        """In Zenoh's thread."""
        self.note(WIRE.decode(sample.payload.to_bytes()).t_s)

    def take_to(self, loop: asyncio.AbstractEventLoop) -> Callable[[zenoh.Sample], None]:
        """In Zenoh's thread: hands over to the loop."""

        def handle(sample: zenoh.Sample) -> None:
            loop.call_soon_threadsafe(self.note, WIRE.decode(sample.payload.to_bytes()).t_s)

        return handle

    def take(self, envelope: Envelope[Any]) -> None:
        """In the loop."""
        self.note(envelope.t_s)

    def poll(self, credit: Publisher, envelope: Envelope[Image]) -> None:
        """In the loop: a picture."""
        self.note(envelope.t_s)
        if not (envelope.sequence + 1) % TOLD_EVERY:
            credit.publish("p/credit", POSE, float(envelope.sequence))

    def report(self) -> Heard:
        """What came since the last report."""
        delays_s, self._delays_s = sorted(self._delays_s), []
        cuts = quantiles(delays_s, n=100) if len(delays_s) > 1 else [0.0] * 99
        return Heard(len(delays_s), cuts[49] * 1e6, cuts[98] * 1e6, self._last_s, time.process_time())


WIRE = msgspec.msgpack.Decoder(Wire)


async def receive(where: Places) -> None:
    """Listens until its input ends; a line of that asks for a report."""
    loop, receiver = asyncio.get_running_loop(), Receiver()
    with ExitStack() as stack:
        raw = stack.enter_context(zenoh.open(configuration(ZenohEndpoints(name="other", connect=(where.raw,)))))
        subscribers = [raw.declare_subscriber(f"p/{name}", receiver.take_raw) for name in NAMES]
        subscribers += [raw.declare_subscriber(f"q/{name}", receiver.take_to(loop)) for name in NAMES]
        for way, place in zip((OURS, SHARED, ZENOHS, TCP), where[1:], strict=True):
            exchange = exchange_at(stack, way, ZenohEndpoints(name="other", connect=(place,)))
            for name in NAMES:
                exchange.subscribe(f"p/{name}", receiver.take)
            exchange.subscribe("p/camera/front", partial(receiver.poll, Publisher(exchange, "p", "receiver", 1)))
        reader = asyncio.StreamReader()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
        print(len(subscribers), flush=True)
        while await reader.readline():
            print(msgspec.json.encode(receiver.report()).decode(), flush=True)


# --- the sending process ---


class Window:
    """Lets so many pictures be under way as the other end has place for."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._sent = self._seen = 0
        self._changed = asyncio.Event()

    def see(self, envelope: Envelope[Any]) -> None:
        """How far the other end is; its time is the number of a picture."""
        self._seen = round(envelope.t_s) + 1
        self._changed.set()

    async def go(self) -> None:
        """Waits for place; what did not come for a while was lost."""
        while self._sent - self._seen >= self._most:
            self._changed.clear()
            try:
                await asyncio.wait_for(self._changed.wait(), LOST_S)
            except TimeoutError:
                self._seen = self._sent
        self._sent += 1


class Sender:
    """What sends, over all that is compared."""

    def __init__(self, stack: ExitStack, where: Places) -> None:
        self._raw = stack.enter_context(
            zenoh.open(configuration(ZenohEndpoints(name="main", listen=(where.raw,), peers=("other",))))
        )
        self._encoder = msgspec.msgpack.Encoder()
        drop, block = zenoh.CongestionControl.DROP, zenoh.CongestionControl.BLOCK
        self._raw_publishers = {
            f"{way}/{name}": self._raw.declare_publisher(
                f"{way}/{name}", congestion_control=block if name == "burst" else drop
            )
            for way in "pq"
            for name in ("pose", "burst", *(f"usual/{number}" for number in range(TOPICS)))
        }
        self._exchanges: dict[str, ZenohExchange] = {}
        self._publishers: dict[str, Publisher] = {}
        self._windows = {way: Window(most) for way, most in IN_FLIGHT.items()}
        for name, place in zip((OURS, SHARED, ZENOHS, TCP), where[1:], strict=True):
            exchange = exchange_at(stack, name, ZenohEndpoints(name="main", listen=(place,), peers=("other",)))
            self._publishers[name] = Publisher(exchange, "p", "sender", 1)
            if name in self._windows:
                exchange.subscribe("p/credit", self._windows[name].see)
        self.child = subprocess.Popen(
            [sys.executable, "-m", "tests.benchmarks.network", *where],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        stack.callback(self._end)
        self._line()

    def _end(self) -> None:
        assert self.child.stdin is not None
        self.child.stdin.close()
        self.child.wait(10.0)

    def _line(self) -> str:
        assert self.child.stdout is not None
        return self.child.stdout.readline()

    async def received(self, settle_s: float = 0.3) -> Heard:
        """What the other process has received since the last time."""
        assert self.child.stdin is not None
        await asyncio.sleep(settle_s)
        self.child.stdin.write("\n")
        self.child.stdin.flush()
        line = await asyncio.get_running_loop().run_in_executor(None, self._line)
        return msgspec.json.decode(line, type=Heard)

    def send(self, way: str, name: str) -> None:
        """A pose."""
        topic = f"{'q' if way == LOOP else 'p'}/{name}"
        if way in (RAW, LOOP):
            message = Wire(time.monotonic(), POSE.position_ned_m, POSE.velocity_ned_m_s, POSE.ned_from_frd)
            self._raw_publishers[topic].put(self._encoder.encode(message))
        else:
            self._publishers[way].publish(topic, POSE, time.monotonic(), "ned")

    async def paced(self, way: str) -> Heard:
        """Poses, one at a time."""
        for _ in range(PACED):
            self.send(way, "pose")
            await asyncio.sleep(PACED_EVERY_S)
        return await self.received()

    async def burst(self, way: str) -> float:
        """Poses as fast as they go; those that came, a second."""
        begin_s = time.monotonic()
        for number in range(BURST):
            self.send(way, "burst")
            if not number % 50:
                await asyncio.sleep(0)
        while time.monotonic() - begin_s < 0.6:
            await asyncio.sleep(0.02)
        received = await self.received(1.0)
        assert received.messages == BURST, f"{way}: {received.messages} of {BURST} came"
        return BURST / (received.last_s - begin_s)

    async def show(self, way: str) -> None:
        """A picture, when so few are under way that there is place for it."""
        await self._windows[way].go()
        self._publishers[way].publish("p/camera/front", PICTURE, time.monotonic(), "")

    async def pictures(self, way: str) -> tuple[Heard, float]:
        """Pictures one at a time, and then as fast as they go: the delay, and those that came, a second."""
        for _ in range(PICTURES):
            await self.show(way)
            await asyncio.sleep(PICTURE_EVERY_S)
        slow = await self.received()
        begin_s = time.monotonic()
        for _ in range(FAST_PICTURES):
            await self.show(way)
        fast = await self.received()
        return slow, fast.messages / (fast.last_s - begin_s)

    async def usual(self, way: str) -> tuple[float, int]:
        """A robot's traffic: the share of a processor that both processes take together, and how many came."""
        before = await self.received()
        begin_s, own_s = time.monotonic(), time.process_time()
        for cycle in range(round(USUAL_S * TOPIC_RATE_HZ)):
            for number in range(TOPICS):
                self.send(way, f"usual/{number}")
            await asyncio.sleep(max(0.0, begin_s + (cycle + 1) / TOPIC_RATE_HZ - time.monotonic()))
        after = await self.received(0.1)
        taken_s = time.process_time() - own_s + after.cpu_s - before.cpu_s
        return taken_s / (time.monotonic() - begin_s), after.messages


class Round(NamedTuple):
    """Everything once; by the way that it went."""

    delay_us: dict[str, float]
    delay_p99_us: dict[str, float]
    rate_hz: dict[str, float]
    picture_us: dict[str, float]
    picture_rate_hz: dict[str, float]
    share: dict[str, float]
    arrived: dict[str, int]


async def rounds(count: int) -> list[Round]:
    """Some rounds, after one that warms up."""
    with tempfile.TemporaryDirectory(prefix="gloc3-") as folder, ExitStack() as stack:
        sender = Sender(stack, places(folder))
        await asyncio.sleep(2.0)
        found = []
        for _ in range(count + 1):
            paced = {way: await sender.paced(way) for way in (RAW, LOOP, OURS)}
            rate_hz = {way: await sender.burst(way) for way in (RAW, LOOP, OURS)}
            shown = {way: await sender.pictures(way) for way in IN_FLIGHT}
            usual = {way: await sender.usual(way) for way in (RAW, LOOP, OURS)}
            found.append(
                Round(
                    {way: each.p50_us for way, each in paced.items()},
                    {way: each.p99_us for way, each in paced.items()},
                    rate_hz,
                    {way: each[0].p50_us for way, each in shown.items()},
                    {way: each[1] for way, each in shown.items()},
                    {way: each[0] for way, each in usual.items()},
                    {way: each[1] for way, each in usual.items()},
                )
            )
        return found[1:]


def measure(count: int = ROUNDS) -> list[Round]:
    """Some rounds."""
    return asyncio.run(rounds(count))


def ratio(found: list[Round], of: Callable[[Round], dict[str, float]], ours: str, other: str) -> float:
    """Ours in the other's, in the middle of the rounds."""
    return median(of(each)[ours] / of(each)[other] for each in found)


def typical(found: list[Round], of: Callable[[Round], dict[str, float]], way: str) -> float:
    """In the middle of the rounds."""
    return median(of(each)[way] for each in found)


def run() -> list[str]:
    """The lines of this bench."""
    found = measure()
    lines = []
    for text, of, unit, ours, other in (
        ("pose, delay p50", lambda r: r.delay_us, "µs", OURS, LOOP),
        ("pose, delay p50", lambda r: r.delay_us, "µs", OURS, RAW),
        ("pose, delay p99", lambda r: r.delay_p99_us, "µs", OURS, LOOP),
        ("poses in a burst", lambda r: r.rate_hz, "/s", OURS, LOOP),
        ("poses in a burst", lambda r: r.rate_hz, "/s", OURS, RAW),
        ("640×480 picture, delay p50", lambda r: r.picture_us, "µs", SHARED, TCP),
        ("640×480 pictures", lambda r: r.picture_rate_hz, "/s", SHARED, TCP),
        ("640×480 picture, delay p50", lambda r: r.picture_us, "µs", ZENOHS, TCP),
        ("640×480 pictures", lambda r: r.picture_rate_hz, "/s", ZENOHS, TCP),
    ):
        values = f"{ours} {typical(found, of, ours):,.0f} {unit}, {other} {typical(found, of, other):,.0f} {unit}"
        lines.append(f"{text}: {values}, ratio {ratio(found, of, ours, other):.2f}")
    share = {way: typical(found, lambda r: r.share, way) for way in (OURS, LOOP, RAW)}
    lines.append(
        f"{TOPICS} topics at {TOPIC_RATE_HZ} Hz, both processes: {OURS} {share[OURS]:.1%} of a processor, "
        f"{LOOP} {share[LOOP]:.1%}, {RAW} {share[RAW]:.1%}"
    )
    lines.append(f"local delivery: {best_us(deliveries):.2f} µs")
    return lines


if __name__ == "__main__":
    asyncio.run(receive(Places(*sys.argv[1:])))
