"""MAVSDK behind the station's link: the station's ids, one heartbeat, signed where the link is, and always ended."""

import asyncio
import os
import random
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from tests.node_runner import NodeRunner

from gloc3.clock import Clock
from gloc3.errors import Refused
from gloc3.exchange import LocalExchange
from gloc3.mavlink.codec import Encoder, Frame, Parser
from gloc3.mavlink.message import Address
from gloc3.mavlink.node import MavlinkComponent
from gloc3.mavlink.services.heartbeat import Heartbeat
from gloc3.mavlink.services.mission_server import MissionServer
from gloc3.mavlink.services.plan import PlanItem, PlanType
from gloc3.mavlink.signing import Signing, SigningVerdict, timestamp
from gloc3.mavlink.transport.memory import Conditions, MemoryLink
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.links.link import LinkContext, LinkSettings, StationLinkCore
from gloc3_groundstation.services import raw
from gloc3_groundstation.services.raw import MavsdkBehindLink

pytestmark = pytest.mark.sockets

VEHICLE, STATION = Address(1, 1), Address(255, 190)
KEY = bytes(range(32))
ITEMS = tuple(PlanItem(command=16, frame=3, x=471_000_000 + n, y=85_000_000, z=10.0) for n in range(20))


class Bench:
    """A vehicle with a mission, at the other end of a memory link in wall time."""

    def __init__(self, *, is_signed: bool = False) -> None:
        loop = asyncio.get_running_loop()
        self.memory = MemoryLink(loop, random.Random(2))
        now = timestamp(Clock(loop).utc_s())
        self.vehicle_signing = Signing(KEY, link_id=1, now=now) if is_signed else None
        self.received: list[Frame] = []
        self.verdicts: list[SigningVerdict] = []
        self.mission = MissionServer(VEHICLE)
        heartbeat = Heartbeat(VEHICLE, vehicle_type=2, autopilot=12, period_s=0.3)
        self.runner = NodeRunner(MavlinkComponent(VEHICLE, [heartbeat, self.mission]), loop, self.memory.b.send)
        self.runner.encoder = Encoder(*VEHICLE, self.vehicle_signing)
        self.memory.b.on_data = self._take
        self.link = StationLinkCore(
            self.memory.a.send,
            LinkContext(loop=loop, exchange=LocalExchange(), topics=TopicTable.installed(), boot=1),
            LinkSettings(key=KEY if is_signed else None),
        )
        self.memory.a.on_data = self.link.receive
        self.mavsdk = MavsdkBehindLink(self.link, VEHICLE)
        self.runner.settle()

    def _take(self, data: bytes) -> None:
        frames = Parser(is_datagram=True).receive(data)
        self.received += frames
        if self.vehicle_signing is not None:
            self.verdicts += [self.vehicle_signing.verify(frame) for frame in frames]
        self.runner.on_data(data)

    def count(self, message_id: int) -> int:
        return sum(frame.message_id == message_id for frame in self.received)


@asynccontextmanager
async def bench(*, is_signed: bool = False) -> AsyncIterator[Bench]:
    made = Bench(is_signed=is_signed)
    try:
        yield made
    finally:
        await made.mavsdk.close()
        made.link.close()
        made.runner.stop()


async def until(is_so: Callable[[], bool], within_s: float = 90.0) -> None:
    async with asyncio.timeout(within_s):
        while not is_so():
            await asyncio.sleep(0.01)


@pytest.mark.parametrize("is_signed", [False, True])
async def test_a_plan_goes_up_and_down_under_the_stations_name(is_signed: bool) -> None:
    async with bench(is_signed=is_signed) as scene:
        fractions: list[float] = []
        await scene.mavsdk.upload(PlanType.MISSION, ITEMS, fractions.append)
        assert scene.mission.plans[PlanType.MISSION][5].x == ITEMS[5].x
        assert [(item.x, item.z) for item in await scene.mavsdk.download(PlanType.MISSION)] == [
            (item.x, item.z) for item in ITEMS
        ]
        assert fractions == sorted(fractions)
        assert {frame.sender for frame in scene.received} == {STATION}
        assert set(scene.verdicts) <= {SigningVerdict.GENUINE}
        sequences = [frame.sequence for frame in scene.received]
        assert sequences == [number % 256 for number in range(len(sequences))]
        assert scene.mavsdk.dropped > 0


async def test_one_station_heartbeat_leaves_and_none_of_mavsdks_questions() -> None:
    async with bench() as scene:
        await scene.mavsdk.download(PlanType.MISSION)
        await until(lambda: scene.count(0) > 1)
        begun, begun_s = scene.count(0), asyncio.get_running_loop().time()
        await until(lambda: scene.count(0) >= begun + 3)
        assert asyncio.get_running_loop().time() - begun_s > 1.6, "one a second, the first of them may be due"
        assert {frame.message_id for frame in scene.received} <= {0, 43, 47, 51, 385}


async def test_nothing_runs_before_the_first_request_and_nothing_after_close() -> None:
    async with bench() as scene:
        assert not scene.mavsdk.is_running
        await scene.mavsdk.download(PlanType.MISSION)
        assert scene.mavsdk.is_running
        await scene.mavsdk.close()
        assert not scene.mavsdk.is_running
        with pytest.raises(Refused, match="are closed"):
            await scene.mavsdk.download(PlanType.MISSION)


async def test_a_process_that_crashes_is_a_refusal_and_the_next_request_begins_another() -> None:
    async with bench() as scene:
        await scene.mavsdk.download(PlanType.MISSION)
        process = scene.mavsdk._process
        assert process is not None
        scene.memory.set_conditions(Conditions(loss=1.0))
        lost = scene.memory.a.lost
        task = asyncio.ensure_future(scene.mavsdk.download(PlanType.MISSION))
        await until(lambda: scene.memory.a.lost > lost)
        os.kill(process.pid, signal.SIGSEGV)
        with pytest.raises(Refused, match="MAVSDK has ended: code -11"):
            await task
        scene.memory.set_conditions(Conditions())
        assert await scene.mavsdk.download(PlanType.MISSION) == ()
        assert scene.mavsdk.starts == 2


async def test_a_cancelled_upload_is_told_to_the_vehicle_and_the_old_plan_stays() -> None:
    async with bench() as scene:
        await scene.mavsdk.upload(PlanType.MISSION, ITEMS[:2])
        scene.memory.set_conditions(Conditions(latency_s=0.1))
        task = asyncio.ensure_future(scene.mavsdk.upload(PlanType.MISSION, ITEMS))
        await until(lambda: scene.count(73) > 5)
        assert not task.done()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await until(lambda: scene.count(47) > 0)
        reported = next(frame for frame in scene.received if frame.message_id == 47).decode()
        assert reported is not None
        assert reported.type == 15
        assert len(scene.mission.plans[PlanType.MISSION]) == 2
        scene.memory.set_conditions(Conditions())
        assert len(await scene.mavsdk.download(PlanType.MISSION)) == 2


async def test_a_vehicle_that_falls_silent_is_a_refusal_in_bounded_time() -> None:
    async with bench() as scene:
        await scene.mavsdk.download(PlanType.MISSION)
        scene.memory.set_conditions(Conditions(loss=1.0))
        async with asyncio.timeout(20.0):
            with pytest.raises(Refused, match="no answer"):
                await scene.mavsdk.download(PlanType.MISSION)


async def test_a_process_that_nobody_asks_for_anything_ends_and_another_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raw, "IDLE_S", 0.05)
    async with bench() as scene:
        await scene.mavsdk.download(PlanType.MISSION)
        await until(lambda: not scene.mavsdk.is_running)
        assert await scene.mavsdk.download(PlanType.MISSION) == ()
        assert scene.mavsdk.starts == 2


async def test_a_request_that_is_cancelled_while_the_process_begins_leaves_nothing_behind() -> None:
    async with bench() as scene:
        task = asyncio.ensure_future(scene.mavsdk.download(PlanType.MISSION))
        await until(lambda: scene.mavsdk.is_running)
        process = scene.mavsdk._process
        assert process is not None
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert process.returncode is not None
        assert await scene.mavsdk.download(PlanType.MISSION) == ()


async def test_a_station_without_mavsdk_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mavsdk.py").write_text("raise ModuleNotFoundError(\"No module named 'mavsdk'\")")
    monkeypatch.syspath_prepend(str(tmp_path))
    async with bench() as scene:
        with pytest.raises(Refused, match=r"it is not installed; install gloc3\[groundstation\]"):
            await scene.mavsdk.download(PlanType.MISSION)


async def test_what_the_library_prints_does_no_harm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    noise = "import os\nfor _ in range(3000): os.write(1, b'x' * 79 + b'\\n')\nraise SystemExit('it is broken')"
    (tmp_path / "mavsdk.py").write_text(noise)
    monkeypatch.syspath_prepend(str(tmp_path))
    async with bench() as scene:
        with pytest.raises(Refused, match="MAVSDK has ended: it is broken"):
            await scene.mavsdk.download(PlanType.MISSION)
