"""Both ends of the link with codec, parser and memory link, and what stands above them in a test."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from math import log2
from random import Random
from typing import Any, TypeVar

from gloc3.exchange.base import Publisher
from gloc3.exchange.mavlink import MavlinkExchange
from gloc3.exchange.tunnel.endpoint import TunnelEndpoint
from gloc3.exchange.tunnel.events import Acknowledged, Counters, Happening, TunnelTrouble, Undelivered
from gloc3.exchange.tunnel.layout import TunnelRole
from gloc3.exchange.tunnel.pacing import RADIO, LinkBudget
from gloc3.mavlink.codec import Encoder, Parser
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.mavlink.transport.memory import Conditions, MemoryEnd, MemoryLink
from gloc3.messages.command_interface import AnyBody, CiReply, CiRequest, LoadMission, Outcome, ReadMission
from gloc3.messages.envelope import Envelope, Message
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.summaries import ComponentLine, ControlState, Health, MissionSummary, Summary, VehicleSummary
from gloc3.messages.topics import TopicTable

RADIO_CONDITIONS = Conditions(latency_s=0.3, loss=0.2, bandwidth_bit_s=57_600.0, bits_per_byte=10.0, queue_bytes=4096)
"""57,600 baud 8N1; every frame lost independently with 20 %; 300 ms each way."""

M = TypeVar("M", bound=Message)

PLATFORM = "minoas"
PLATFORM_ADDRESS = Address(1, 191)
STATION_ADDRESS = Address(255, 190)


def text_of(size: int, random: Random, *, is_random: bool) -> str:
    """A mission's text: of random characters, so many that `size` bytes remain deflated, or YAML of so many bytes."""
    if is_random:
        return "".join(chr(random.randrange(0x20, 0x7F)) for _ in range(round(size * 8.0 / log2(0x5F))))
    lines = ["mission: survey", "tasks:", "  sweep:", "    actions:"]
    length = sum(len(line) + 1 for line in lines)
    while length < size:
        x, y, height = (round(random.uniform(0.0, 40.0), 2) for _ in range(3))
        lines.append(
            f"      leg{len(lines)}: {{follow_waypoints: {{waypoints_m: [[{x}, {y}, {height}]], speed_m_s: 0.5}}}}"
        )
        length += len(lines[-1]) + 1
    return "\n".join(lines)[:size]


class End:
    """An exchange with codec and parser on one end of one or more memory links."""

    def __init__(
        self,
        role: TunnelRole,
        name: str,
        address: Address,
        boot: int,
        lines: Iterable[MemoryEnd],
        *,
        topics: TopicTable | None = None,
        budget: LinkBudget = RADIO,
    ) -> None:
        self.loop = asyncio.get_running_loop()
        self.encoder = Encoder(*address)
        self.lines = list(lines)
        self.endpoint = TunnelEndpoint(role, name, address, boot, topics or standard_topics(), budget)
        self.exchange = MavlinkExchange(self.endpoint, self.loop, self.send)
        self.publisher = Publisher(self.exchange, name, "ci", boot)
        self.events: list[Happening] = []
        self.exchange.listen(self.events.append)
        for line in self.lines:
            line.on_data = self.take

    @property
    def counters(self) -> Counters:
        return self.endpoint.counters

    def send(self, message: MavlinkMessage) -> None:
        data = self.encoder.encode(message)
        for line in self.lines:
            line.send(data)

    def take(self, data: bytes) -> None:
        for frame in Parser(is_datagram=True).receive(data):
            message = frame.decode()
            if message is not None:
                self.exchange.receive(message, frame.sender)

    def close(self) -> None:
        self.exchange.close()
        for line in self.lines:
            line.on_data = None

    def problems(self) -> list[str]:
        return [happening.text for happening in self.events if isinstance(happening, TunnelTrouble)]

    def undelivered(self) -> list[Undelivered]:
        return [happening for happening in self.events if isinstance(happening, Undelivered)]


class Platform(End):
    """A platform with a command interface server as plain as it can be: it keeps the mission and answers."""

    def __init__(
        self,
        boot: int,
        *lines: MemoryEnd,
        name: str = PLATFORM,
        address: Address = PLATFORM_ADDRESS,
        topics: TopicTable | None = None,
        budget: LinkBudget = RADIO,
    ) -> None:
        super().__init__(TunnelRole.PLATFORM, name, address, boot, lines, topics=topics, budget=budget)
        self.name = name
        self.text = ""
        self.given: list[tuple[float, CiRequest]] = []
        """What was handed over, and when."""
        self.exchange.subscribe(f"{name}/ci/request", self.serve)

    def send_text(self, topic: str, message: Message) -> None:
        self.publisher.publish(f"{self.name}/ci/{topic}", message, self.loop.time())

    def serve(self, envelope: Envelope[Any]) -> None:
        request: CiRequest = envelope.payload
        self.given.append((self.loop.time(), request))
        text = ""
        if isinstance(request.body, LoadMission):
            self.text = request.body.text
        elif isinstance(request.body, ReadMission):
            text = self.text
        sender, boot, sequence = request.sender, request.boot, request.sequence
        self.send_text(
            "reply", CiReply(sender=sender, boot=boot, sequence=sequence, outcome=Outcome.ACCEPTED, text=text)
        )

    def sequences(self, sender: str = "255") -> list[int]:
        """The sequences of a station's requests in the order in which they were handed over."""
        return [request.sequence for _, request in self.given if request.sender == sender]

    def report(self, components: int, count: int = 0) -> None:
        """Publishes status at the topics' rates from now on."""
        now_s = self.loop.time()
        lines = [ComponentLine(n, n % 3, 100, (n + count) % 50, n // 7, 0) for n in range(components)]
        self.send_text("summary", Summary(table=1, health=Health.WORKING, lines=lines))
        self.send_text(
            "vehicle",
            VehicleSummary(
                t_s=now_s,
                mode="OFFBOARD",
                is_armed=True,
                landed="in_air",
                battery_percent=77,
                position_m=(count / 7, count / 9, 2.0 + count / 900),
                speed_m_s=0.5,
                heading_deg=count % 360,
                is_pose_valid=True,
                has_pilot_control=False,
                is_autopilot_connected=True,
                frame="hold",
            ),
        )
        if count % 2 == 0:
            tasks = {f"task{n}.action": "waiting" for n in range(8)}
            progress = {"task1.action": count / 1e3}
            self.send_text(
                "mission",
                MissionSummary(name="survey", digest="0123abcd", state="running", tasks=tasks, progress=progress),
            )
            self.send_text("control", ControlState(holder="255"))
        self.loop.call_later(0.5, self.report, components, count + 1)


class Station(End):
    """A station that asks and remembers what comes."""

    def __init__(
        self,
        boot: int,
        *lines: MemoryEnd,
        name: str = "255",
        address: Address = STATION_ADDRESS,
        topics: TopicTable | None = None,
        budget: LinkBudget = RADIO,
    ) -> None:
        super().__init__(TunnelRole.STATION, name, address, boot, lines, topics=topics, budget=budget)
        self.name = name
        self.boot = boot
        self.requested = 0
        self.came: list[tuple[float, Envelope[Any]]] = []
        self.replies: dict[int, tuple[float, CiReply]] = {}
        self.exchange.subscribe("*/ci/*", self.receive)

    def request(self, body: AnyBody, platform: str = PLATFORM) -> int:
        """Sends a request; its sequence."""
        sequence, self.requested = self.requested, self.requested + 1
        request = CiRequest(sender=self.name, boot=self.boot, sequence=sequence, body=body)
        self.publisher.publish(f"{platform}/ci/request", request, self.loop.time())
        return sequence

    def receive(self, envelope: Envelope[Any]) -> None:
        if isinstance(envelope.payload, CiRequest):
            return
        self.came.append((self.loop.time(), envelope))
        if isinstance(envelope.payload, CiReply):
            self.replies[envelope.payload.sequence] = (self.loop.time(), envelope.payload)

    def received(self, message_type: type[M]) -> list[M]:
        """The messages of a type, in the order in which they came."""
        return [envelope.payload for _, envelope in self.came if isinstance(envelope.payload, message_type)]

    def acknowledged(self) -> list[int]:
        """The sequences of the requests that were acknowledged."""
        return [happening.envelope.payload.sequence for happening in self.events if isinstance(happening, Acknowledged)]


def pair_on(
    seed: int, conditions: Conditions = RADIO_CONDITIONS, *, is_half_duplex: bool = False, budget: LinkBudget = RADIO
) -> tuple[Station, Platform, MemoryLink]:
    """A station and a platform on one link."""
    random = Random(seed)
    link = MemoryLink(asyncio.get_running_loop(), random, conditions, is_half_duplex=is_half_duplex)
    station = Station(random.getrandbits(32), link.a, budget=budget)
    return station, Platform(random.getrandbits(32), link.b, budget=budget), link


def standard_topics() -> TopicTable:
    """Our own topics, without those of installed packages."""
    table = TopicTable()
    table.add(TOPICS)
    return table
