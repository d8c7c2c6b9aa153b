"""A mission is uploaded and read back over a lossy 57,600 baud link in virtual time, beside status of 20 components."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from math import log2
from random import Random
from typing import Any

import msgspec

from gloc3.ci import (
    CiReply,
    CiRequest,
    ComponentLine,
    ControlState,
    Health,
    LoadMission,
    MissionSummary,
    Outcome,
    ReadMission,
    Summary,
    VehicleSummary,
)
from gloc3.clock import VirtualLoop
from gloc3.exchange.base import Publisher
from gloc3.exchange.mavlink import MavlinkExchange
from gloc3.exchange.tunnel.endpoint import TunnelEndpoint
from gloc3.exchange.tunnel.layout import Role
from gloc3.exchange.tunnel.pacing import RADIO, LinkBudget
from gloc3.link.codec import Encoder, Parser
from gloc3.link.memory import Conditions, MemoryEnd, MemoryLink
from gloc3.link.message import Address, MavlinkMessage
from gloc3.messages import Envelope
from gloc3.standard_topics import TOPICS
from gloc3.topics import TopicTable

RADIO_CONDITIONS = Conditions(
    latency_s=0.3, loss=0.2, bandwidth_bit_s=57_600.0, bits_per_byte=10.0, queue_bytes=4096
)
"""57,600 baud 8N1; every frame lost independently with 20 %; 300 ms each way."""

PLATFORM = "minoas"


class Figures(msgspec.Struct, frozen=True, kw_only=True):
    """What one run showed; times in seconds."""

    upload_s: float
    """From the request at the station to its hand-over at the platform; infinite if it never came."""
    replied_s: float
    """Until the platform's reply was back at the station."""
    read_back_s: float
    """From the request to read back until the text is at the station."""
    is_equal: bool
    handed_over: dict[int, int]
    """Request's sequence: how often it was handed over."""
    acknowledged: list[int]
    """Sequences of the requests that were acknowledged."""
    slowest_status_hz: float
    """Mean rate at which the least lucky component's row arrived over the first 60 s."""
    longest_gap_s: float
    """Longest time without a row of some component over the first 60 s."""
    status_share: float
    """Status, greetings and tables, of what the line carries, over the first 60 s."""
    status_share_in_upload: float
    """The same while the mission went up and was read back."""


def text_of(size: int, random: Random, *, is_random: bool) -> str:
    """A mission's text: of random characters, so many that `size` bytes remain deflated, or YAML of so many bytes."""
    if is_random:
        return "".join(chr(random.randrange(0x20, 0x7F)) for _ in range(round(size * 8.0 / log2(0x5F))))
    lines = ["mission: survey", "tasks:", "  sweep:", "    actions:"]
    length = sum(len(line) + 1 for line in lines)
    while length < size:
        x, y, height = (round(random.uniform(0.0, 40.0), 2) for _ in range(3))
        lines.append(f"      leg{len(lines)}: {{follow_waypoints: {{waypoints_m: [[{x}, {y}, {height}]], speed_m_s: 0.5}}}}")
        length += len(lines[-1]) + 1
    return "\n".join(lines)[:size]


class End:
    """An exchange with codec and parser on one end of a memory link."""

    def __init__(
        self,
        role: Role,
        name: str,
        address: Address,
        boot: int,
        line: MemoryEnd,
        loop: asyncio.AbstractEventLoop,
        topics: TopicTable,
        budget: LinkBudget = RADIO,
    ) -> None:
        self.encoder = Encoder(*address)
        self.parser = Parser(is_datagram=True)
        self.line = line
        self.endpoint = TunnelEndpoint(role, name, address, boot, topics, budget)
        self.exchange = MavlinkExchange(self.endpoint, loop, self.send)
        self.publisher = Publisher(self.exchange, name, "ci", boot)
        line.on_data = self.take

    def send(self, message: MavlinkMessage) -> None:
        self.line.send(self.encoder.encode(message))

    def take(self, data: bytes) -> None:
        for frame in self.parser.receive(data):
            message = frame.decode()
            if message is not None:
                self.exchange.receive(message, frame.sender)

    def close(self) -> None:
        self.exchange.close()
        self.line.on_data = None


def standard_topics() -> TopicTable:
    table = TopicTable()
    table.add(TOPICS)
    return table


def status_of(platform: End, loop: asyncio.AbstractEventLoop, components: int) -> Callable[[], None]:
    """Publishes a platform's status at the topics' rates for ever; call it once."""
    topic = f"{PLATFORM}/ci/"
    tasks = {f"task{n}.action": "waiting" for n in range(8)}

    def tick(count: int = 0) -> None:
        now_s = loop.time()
        lines = [ComponentLine(n, n % 3, 100, (n + count) % 50, n // 7, 0) for n in range(components)]
        platform.publisher.publish(topic + "summary", Summary(table=1, health=Health.WORKING, lines=lines), now_s)
        vehicle = VehicleSummary(
            t_s=now_s, mode="OFFBOARD", is_armed=True, landed="in_air", battery_percent=77,
            position_m=(count / 7, count / 9, 2.0 + count / 900), speed_m_s=0.5, heading_deg=count % 360,
            is_pose_valid=True, has_pilot_control=False, is_autopilot_connected=True, frame="hold",
        )  # fmt: skip
        platform.publisher.publish(topic + "vehicle", vehicle, now_s)
        if count % 2 == 0:
            mission = MissionSummary(
                name="survey", digest="0123abcd", state="running", tasks=tasks, progress={"task1.action": count / 1e3}
            )
            platform.publisher.publish(topic + "mission", mission, now_s)
            platform.publisher.publish(topic + "control", ControlState(holder="255"), now_s)
        loop.call_later(0.5, tick, count + 1)

    return tick


class Server:
    """A command interface server as plain as it can be: keeps the mission, answers, remembers what it was given."""

    def __init__(self, end: End, loop: asyncio.AbstractEventLoop) -> None:
        self.end = end
        self.loop = loop
        self.text = ""
        self.given: list[tuple[float, CiRequest]] = []
        end.exchange.subscribe(f"{PLATFORM}/ci/request", self.take)

    def take(self, envelope: Envelope[Any]) -> None:
        request: CiRequest = envelope.payload
        self.given.append((self.loop.time(), request))
        text = ""
        if isinstance(request.body, LoadMission):
            self.text = request.body.text
        elif isinstance(request.body, ReadMission):
            text = self.text
        reply = CiReply(
            sender=request.sender, boot=request.boot, sequence=request.sequence, outcome=Outcome.ACCEPTED, text=text
        )
        self.end.publisher.publish(f"{PLATFORM}/ci/reply", reply, self.loop.time())


def scenario(
    seed: int,
    *,
    size: int = 20_000,
    is_random: bool = True,
    components: int = 20,
    duration_s: float = 60.0,
    conditions: Conditions = RADIO_CONDITIONS,
    is_half_duplex: bool = False,
    budget: LinkBudget = RADIO,
) -> Figures:
    """Uploads a mission of `size` characters 5 s after the start, reads it back, and watches status meanwhile."""
    loop = VirtualLoop()
    try:
        return loop.run_until_complete(
            _run(loop, Random(seed), size, is_random, components, duration_s, conditions, is_half_duplex, budget)
        )
    finally:
        loop.close()


async def _run(
    loop: VirtualLoop,
    random: Random,
    size: int,
    is_random: bool,
    components: int,
    duration_s: float,
    conditions: Conditions,
    is_half_duplex: bool,
    budget: LinkBudget,
) -> Figures:
    link = MemoryLink(loop, random, conditions, is_half_duplex=is_half_duplex)
    topics = standard_topics()
    station = End(Role.STATION, "255", Address(255, 190), random.getrandbits(32), link.a, loop, topics, budget)
    platform = End(Role.PLATFORM, PLATFORM, Address(1, 191), random.getrandbits(32), link.b, loop, topics, budget)
    server = Server(platform, loop)
    status_of(platform, loop, components)()

    rows: dict[int, list[float]] = {n: [0.0] for n in range(components)}
    replies: dict[int, tuple[float, CiReply]] = {}
    acknowledged: list[int] = []

    def take_summary(envelope: Envelope[Any]) -> None:
        for line in envelope.payload.lines:
            rows[line.index].append(loop.time())

    def take_reply(envelope: Envelope[Any]) -> None:
        replies[envelope.payload.sequence] = (loop.time(), envelope.payload)

    def listen(happening: object) -> None:
        if type(happening).__name__ == "Acknowledged":
            acknowledged.append(happening.envelope.payload.sequence)  # type: ignore[attr-defined]

    station.exchange.subscribe("*/ci/summary", take_summary)
    station.exchange.subscribe("*/ci/reply", take_reply)
    station.exchange.listen(listen)

    async def until(sequence: int, limit_s: float) -> None:
        while sequence not in replies and loop.time() < limit_s:
            await asyncio.sleep(0.05)

    text = text_of(size, random, is_random=is_random)
    await asyncio.sleep(5.0)
    begin_s = loop.time()
    status_before = platform.endpoint.counters.status_bytes
    station.publisher.publish(
        f"{PLATFORM}/ci/request",
        CiRequest(sender="255", boot=7, sequence=0, body=LoadMission(name="survey", text=text)),
        begin_s,
    )
    await until(0, begin_s + duration_s)
    read_s = loop.time()
    station.publisher.publish(
        f"{PLATFORM}/ci/request", CiRequest(sender="255", boot=7, sequence=1, body=ReadMission()), read_s
    )
    await until(1, read_s + duration_s)
    end_s = loop.time()
    status_in_upload = platform.endpoint.counters.status_bytes - status_before
    if end_s < duration_s:
        await asyncio.sleep(duration_s - end_s)
    measured_s = loop.time()
    station.close()
    platform.close()

    given = {request.sequence: t_s for t_s, request in reversed(server.given)}
    counts = [request.sequence for _, request in server.given]
    never = float("inf")
    return Figures(
        upload_s=given.get(0, never) - begin_s,
        replied_s=replies[0][0] - begin_s if 0 in replies else never,
        read_back_s=replies[1][0] - read_s if 1 in replies else never,
        is_equal=1 in replies and replies[1][1].text == text,
        handed_over={sequence: counts.count(sequence) for sequence in set(counts)},
        acknowledged=acknowledged,
        slowest_status_hz=min(len(times) - 1 for times in rows.values()) / measured_s,
        longest_gap_s=max(
            later - earlier
            for times in rows.values()
            for earlier, later in zip(times, [*times[1:], measured_s], strict=True)
        ),
        status_share=platform.endpoint.counters.status_bytes / (budget.rate_byte_s * measured_s),
        status_share_in_upload=status_in_upload / (budget.rate_byte_s * (end_s - begin_s)),
    )
