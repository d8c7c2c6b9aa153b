"""A radio of 57,600 baud that loses one frame in ten each way, behind the router, while the autopilot streams.

The autopilot tells several times more than the radio carries. Meanwhile the companion reports its components, a mission goes
to it, a plan goes to the autopilot, and the autopilot is commanded; then the radio is cut, and comes back.
"""

import asyncio
from itertools import pairwise
from math import inf
from random import Random

import msgspec
from tests.node_runner import NodeRunner

from gloc3.clock import run_virtual
from gloc3.exchange import LocalExchange, Publisher
from gloc3.exchange.tunnel.pacing import RADIO
from gloc3.mavlink.codec import Frame, MavlinkMessage, message, shape
from gloc3.mavlink.message import Address
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.router import Router
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_client import CommandCall, MavCommandClient
from gloc3.mavlink.services.command_server import MavCommandServer
from gloc3.mavlink.services.heartbeat import Heartbeat
from gloc3.mavlink.services.mission_client import MissionClient
from gloc3.mavlink.services.mission_server import MissionServer
from gloc3.mavlink.services.plan import PlanItem, PlanResult, PlanType
from gloc3.mavlink.transport.memory import Conditions, MemoryLink
from gloc3.messages.command_interface import CiRequest, LoadMission
from gloc3.messages.envelope import Envelope
from gloc3.messages.summaries import ComponentLine, Health, Summary
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.links.link import LinkContext, LinkSettings, StationLinkCore
from gloc3_onboard.companion.routing import RoutedLink
from gloc3_onboard.companion.station_link import StationLink, heartbeat

LOSS = 0.1
RADIO_CONDITIONS = Conditions(latency_s=0.05, loss=LOSS, bandwidth_bit_s=57_600.0, bits_per_byte=10.0)
AUTOPILOT, STATION = Address(1, 1), Address(255, 190)
STREAMED = [
    "ATTITUDE",
    "ATTITUDE_QUATERNION",
    "LOCAL_POSITION_NED",
    "GLOBAL_POSITION_INT",
    "HIGHRES_IMU",
    "VFR_HUD",
    "SERVO_OUTPUT_RAW",
    "RC_CHANNELS",
    "SYS_STATUS",
    "BATTERY_STATUS",
]
STREAM_S = 0.02
COMPONENTS = 20
ITEMS = 50
MISSION_BYTES = 8_000
SETTLED_S, BUSY_S, CUT_S = 10.0, 60.0, 20.0
COMMAND, EVERY_S = 178, 2.0
"""MAV_CMD_DO_CHANGE_SPEED."""


class Figures(msgspec.Struct, kw_only=True):
    """What one run showed; times in seconds."""

    slowest_stream_hz: float = 0.0
    """Of the autopilot's streams, the one that came least often."""
    heartbeat_gap_s: float = 0.0
    """The longest time without one, of autopilot or companion."""
    slowest_report_hz: float = 0.0
    """Rate of the companion's least lucky component."""
    report_gap_s: float = 0.0
    mission_s: float = inf
    """A mission of 8 kB to the companion; infinite if it never came."""
    plan_s: float = inf
    """A plan of 50 items to the autopilot."""
    is_equal: bool = False
    """Whether both came as they were sent."""
    commands: int = 0
    unanswered: int = 0
    slowest_answer_s: float = 0.0
    ran_twice: int = 0
    used: float = 0.0
    """Share of the line that was used."""
    overfilled: int = 0
    """Frames that the radio had no room for."""
    command_gives_up_s: float = inf
    """With the radio cut."""
    plan_gives_up_s: float = inf
    back_s: float = inf
    """From the end of the cut to the next heartbeat and the next answer."""


class _Autopilot:
    """Answers commands, takes plans, and streams far more than the radio carries."""

    def __init__(self, link: MemoryLink) -> None:
        self.missions = MissionServer(AUTOPILOT)
        self.ran: list[float] = []
        self._commands = MavCommandServer(AUTOPILOT, is_autopilot=True)
        self._loop = asyncio.get_running_loop()
        node = MavlinkComponent(
            AUTOPILOT, [Heartbeat(AUTOPILOT, vehicle_type=2, autopilot=12), self._commands, self.missions]
        )
        self._runner = NodeRunner(node, self._loop, link.b.send, after=self._after)
        self._send = link.b.send
        link.b.on_data = self._runner.on_data
        self._stream(0)
        self._runner.settle()

    def _after(self, now_s: float) -> None:
        for request in self._commands.events():
            self.ran.append(request.params[1])
            self._commands.answer(request, CommandResult.ACCEPTED, now_s=now_s)

    def _stream(self, number: int) -> None:
        for name in STREAMED:
            self._send(self._runner.encoder.encode(_full(name, number)))
        self._loop.call_later(STREAM_S, self._stream, number + 1)


def _full(name: str, number: int) -> MavlinkMessage:
    """A message of which every single value is set, so that it is as long on the line as in flight."""
    single = [field for field in shape(name).fields if not field.elements]
    fields = {field.attribute: 1 if field.name == "id" else number % 50 + 1 for field in single}
    return message(name, **fields)


def scenario(seed: int, busy_s: float = BUSY_S) -> Figures:
    """One run in virtual time."""
    return run_virtual(_run(seed, busy_s))


class _Scene:
    """The whole way: autopilot, router, radio, station."""

    def __init__(self, seed: int) -> None:
        loop = asyncio.get_running_loop()
        self.loop, chance, topics = loop, Random(seed), TopicTable.installed()
        cable = MemoryLink(loop, Random(seed + 1), Conditions(latency_s=0.001))
        self.radio = MemoryLink(loop, chance, RADIO_CONDITIONS)
        self.autopilot = _Autopilot(cable)
        self.here, self.there = LocalExchange(), LocalExchange()
        router = Router(Address(1, 191))
        self.station_link = StationLink("heron", 1, loop, self.here, topics, 7)
        vehicle = RoutedLink("serial:///dev/ttyACM0:921600", router, loop)
        self.routed = RoutedLink("serial:///dev/ttyUSB0:57600", router, loop, [self.station_link.receive_frames])
        for routed, end in ((vehicle, cable.a), (self.routed, self.radio.a)):
            end.on_data = routed.receive
            routed.open(end)
        self.station_link.open(self.routed)
        self.link = StationLinkCore(
            self.radio.b.send,
            LinkContext(loop=loop, exchange=self.there, topics=topics, system=STATION.system, boot=8),
            LinkSettings(budget=RADIO),
        )
        self.radio.b.on_data = self._received
        self.bytes_heard = 0
        self.came: dict[tuple[int, str], list[float]] = {}
        self.rows: dict[int, list[float]] = {}
        self.given: list[tuple[float, CiRequest]] = []
        self.commands, self.missions = MavCommandClient(STATION), MissionClient(STATION)
        self.node = MavlinkComponent(STATION, [self.commands, self.missions])
        self.link.listen(self._receive)
        self.here.subscribe("heron/ci/request", lambda one: self.given.append((loop.time(), one.payload)))
        self.there.subscribe("heron/ci/summary", self._summary)
        self._publisher = Publisher(self.here, "heron", "ci", 7)
        self._report()
        self._tick()

    def _received(self, data: bytes) -> None:
        self.bytes_heard += len(data)
        self.link.receive(data)

    def _receive(self, frame: Frame) -> None:
        if frame.shape is not None:
            self.came.setdefault((frame.component, frame.shape.name), []).append(self.loop.time())
        self.node.receive(frame, self.loop.time())
        self._settle()

    def _settle(self) -> None:
        for outgoing in self.node.outgoing():
            self.link.send(outgoing)

    def _tick(self) -> None:
        self.node.tick(self.loop.time())
        self._settle()
        self.loop.call_later(0.05, self._tick)

    def _summary(self, envelope: Envelope[Summary]) -> None:
        for line in envelope.payload.lines:
            self.rows.setdefault(line.index, []).append(self.loop.time())

    def _report(self) -> None:
        now_s = self.loop.time()
        lines = [ComponentLine(index, 1, 100, 10, round(now_s) & 0xFFFF, 0) for index in range(COMPONENTS)]
        self._publisher.publish("heron/ci/summary", Summary(table=1, health=Health.WORKING, lines=lines), now_s)
        if round(now_s * 2) % 2 == 0:
            self.station_link.send(heartbeat(Health.WORKING))
        self.loop.call_later(0.5, self._report)

    def command(self, number: int) -> CommandCall:
        """Commands the autopilot once."""
        call = self.commands.send_long(AUTOPILOT, COMMAND, (1.0, float(number)), now_s=self.loop.time())
        self._settle()
        return call

    def upload(self, items: int) -> "asyncio.Task[tuple[float, PlanResult | None]]":
        """Uploads a plan; how long it took, and how it ended."""
        plan = [PlanItem(command=16, frame=3, x=10 * n, y=20 * n, z=5.0, is_current=n == 0) for n in range(items)]
        transfer = self.missions.upload(AUTOPILOT, plan, now_s=self.loop.time())
        self._settle()
        return self.loop.create_task(self._ended(transfer))

    async def _ended(self, transfer: object) -> tuple[float, PlanResult | None]:
        began_s = self.loop.time()
        while getattr(transfer, "result", None) is None and self.loop.time() < began_s + 300.0:
            await asyncio.sleep(0.05)
        return self.loop.time() - began_s, getattr(transfer, "result", None)

    async def answer_s(self, number: int, timeout_s: float = 10.0) -> float | None:
        """Commands, and waits for the answer: how long it took; None where there was none."""
        began_s, call = self.loop.time(), self.command(number)
        while call.result is None and self.loop.time() < began_s + timeout_s:
            await asyncio.sleep(0.02)
        return self.loop.time() - began_s if call.result is CommandResult.ACCEPTED else None

    def heartbeats(self) -> list[list[float]]:
        """When those of the autopilot and of the companion came."""
        return [self.came.get((component, "HEARTBEAT"), []) for component in (1, 191)]


async def _run(seed: int, busy_s: float) -> Figures:
    scene, figures = _Scene(seed), Figures()
    loop, radio = scene.loop, scene.radio
    await asyncio.sleep(SETTLED_S)
    begin_s, bytes_before = loop.time(), scene.bytes_heard
    text = "".join(Random(seed).choices("abcdefghijklmnopqrstuvwxyz0123456789", k=MISSION_BYTES * 8 // 5))
    request = CiRequest(sender="255", boot=8, sequence=0, body=LoadMission(name="survey", text=text))
    Publisher(scene.there, "station", "client", 8).publish("heron/ci/request", request, begin_s)
    plan = scene.upload(ITEMS)
    answers: list[float | None] = []
    while loop.time() < begin_s + busy_s:
        next_s = loop.time() + EVERY_S
        answers.append(await scene.answer_s(len(answers)))
        await asyncio.sleep(max(0.0, next_s - loop.time()))
    end_s = loop.time()
    figures.plan_s, result = await plan
    sent = [(10 * n, 20 * n) for n in range(ITEMS)]
    missions = [(t_s, one.body) for t_s, one in scene.given if isinstance(one.body, LoadMission)]
    figures.is_equal = (
        result is PlanResult.ACCEPTED
        and [(item.x, item.y) for item in scene.autopilot.missions.plans[PlanType.MISSION]] == sent
        and [body.text for _, body in missions] == [text]
    )
    figures.mission_s = missions[0][0] - begin_s if missions else inf
    figures.commands, figures.unanswered = len(answers), answers.count(None)
    figures.slowest_answer_s = max((answer for answer in answers if answer is not None), default=inf)
    figures.ran_twice = len(scene.autopilot.ran) - len(set(scene.autopilot.ran))
    figures.slowest_stream_hz = min(_rate(scene.came.get((1, name), []), begin_s, end_s) for name in STREAMED)
    figures.heartbeat_gap_s = max(_gap(times, begin_s, end_s) for times in scene.heartbeats())
    rows = [scene.rows.get(index, []) for index in range(COMPONENTS)]
    figures.slowest_report_hz = min(_rate(times, begin_s, end_s) for times in rows)
    figures.report_gap_s = max(_gap(times, begin_s, end_s) for times in rows)
    figures.used = (scene.bytes_heard - bytes_before) / (1.0 - LOSS) / (5760.0 * (end_s - begin_s))
    await _cut(scene, figures)
    figures.overfilled = radio.a.dropped + radio.b.dropped
    scene.link.close()
    scene.station_link.close()
    return figures


async def _cut(scene: _Scene, figures: Figures) -> None:
    """Cuts the radio in the middle of an upload and a command, and mends it."""
    loop, began_s = scene.loop, scene.loop.time()
    plan = scene.upload(400)
    await asyncio.sleep(1.0)
    scene.radio.set_conditions(msgspec.structs.replace(RADIO_CONDITIONS, loss=1.0))
    cut_s = loop.time()
    call = scene.command(1000)
    while call.result is None:
        await asyncio.sleep(0.05)
    figures.command_gives_up_s = loop.time() - cut_s
    figures.plan_gives_up_s = (await plan)[0] - (cut_s - began_s)
    await asyncio.sleep(max(0.0, cut_s + CUT_S - loop.time()))
    scene.radio.set_conditions(RADIO_CONDITIONS)
    mended_s = loop.time()
    await scene.answer_s(1001, 20.0)
    while not all(times and times[-1] > mended_s for times in scene.heartbeats()):
        await asyncio.sleep(0.05)
    figures.back_s = loop.time() - mended_s


def _rate(times: list[float], begin_s: float, end_s: float) -> float:
    return sum(begin_s <= t_s < end_s for t_s in times) / (end_s - begin_s)


def _gap(times: list[float], begin_s: float, end_s: float) -> float:
    inside = [begin_s, *(t_s for t_s in times if begin_s <= t_s < end_s), end_s]
    return max(later - earlier for earlier, later in pairwise(inside))
