"""Logs are fetched over the network of platforms and stations, go on after breaks, and are deleted when they are here."""

import asyncio
from collections.abc import Coroutine
from hashlib import sha256
from pathlib import Path
from random import Random
from typing import Any

import pytest
from tests.groundstation.scripted_platform import VEHICLE

from gloc3.clock import VirtualLoop
from gloc3.component.workers import ImmediateExecutor
from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange import LocalExchange, Publisher
from gloc3.messages.command_interface import (
    QUERIES,
    AboutLogs,
    CiReply,
    CiRequest,
    ConfirmLog,
    CutLog,
    ListLogs,
    LogChunk,
    LogOnboard,
    Outcome,
    ReadLog,
)
from gloc3.messages.envelope import Envelope
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store.log_pull import ChunkCarrier, LogPuller, Pulled
from gloc3_onboard.command_server.journal import answer
from gloc3_onboard.command_server.log_shelf import LogStore

LATENCY_S = 0.3


class Vessel:
    """A platform's shelf of logs behind a way that loses pieces, and can be cut off."""

    def __init__(self, folder: Path, loss: float = 0.0, unfinished: str = "") -> None:
        self.folder, self.loss, self.is_cut_off = folder, loss, False
        self.may_only_look = False
        """Whether the station is one that may look and not command."""
        self.running = self.most_under_way = 0
        topics, loop = TopicTable.installed(), asyncio.get_running_loop()
        self.exchange = LocalExchange(topics)
        self._random, self._loop = Random(1), loop
        self._log_store = LogStore(folder, lambda: {folder / unfinished}, lambda: None, ImmediateExecutor())
        self._publisher = Publisher(self.exchange, "auv", "command_server", 1)
        self.exchange.subscribe("auv/ci/request", self._take)
        self.station = Station(self.exchange, loop, "255", 1)
        self._report()

    def _report(self) -> None:
        if not self.is_cut_off:
            self._publisher.publish("auv/ci/vehicle", VEHICLE, self._loop.time())
        self._timer = self._loop.call_later(0.5, self._report)

    def _take(self, envelope: Envelope[CiRequest]) -> None:
        if self.is_cut_off or not isinstance(envelope.payload.body, AboutLogs):
            return
        reply = self._requested(envelope.payload)
        for reported in [*([] if reply is None else [reply]), *self._log_store.collect()]:
            if isinstance(reported, LogChunk):
                self.running += 1
                self.most_under_way = max(self.most_under_way, self.running)
                if self._random.random() < self.loss:
                    self.running -= 1
                    continue
            self._loop.call_later(LATENCY_S, self._arrive, reported)

    def _requested(self, request: CiRequest) -> CiReply | None:
        if self.may_only_look and not isinstance(request.body, QUERIES):
            return answer(request, Outcome.REFUSED, "station 255 may look and not command")
        return self._log_store.handle(request)

    def _arrive(self, reported: Any) -> None:
        self.running -= isinstance(reported, LogChunk)
        if not self.is_cut_off:
            topic = "log_chunk" if isinstance(reported, LogChunk) else "ci/reply"
            self._publisher.publish(f"auv/{topic}", reported, self._loop.time())

    def answer(self, reply: CiReply) -> None:
        self._publisher.publish("auv/ci/reply", reply, self._loop.time())

    def close(self) -> None:
        self._timer.cancel()
        self.station.close()

    def puller(self, reported: Any = lambda _: None, came: Any = lambda *_: None) -> LogPuller:
        return LogPuller(self.station, "auv", ChunkCarrier(self.station, self.exchange, "auv"), came, reported)


@pytest.fixture
def there(tmp_path: Path) -> Path:
    folder = tmp_path / "there"
    folder.mkdir()
    (folder / "log.mcap").write_bytes(Random(0).randbytes(1_000_003))
    (folder / "requests.journal").write_bytes(b"secret")
    return folder


@pytest.fixture
def here(tmp_path: Path) -> Path:
    folder = tmp_path / "here"
    folder.mkdir()
    return folder


def in_virtual_time(steps: Coroutine[Any, Any, Pulled]) -> Pulled:
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(steps)


def test_a_log_comes_over_a_lossy_way_that_breaks_off_five_times(there: Path, here: Path) -> None:
    wanted = sha256((there / "log.mcap").read_bytes()).hexdigest()

    async def steps() -> Pulled:
        vessel = Vessel(there, loss=0.1)
        breaks = [100_000, 250_000, 400_000, 600_000, 800_000]

        def came(_name: str, at: int, _size: int) -> None:
            if breaks and at >= breaks[0] and not vessel.is_cut_off:
                breaks.pop(0)
                vessel.is_cut_off = True
                asyncio.get_running_loop().call_later(15.0, setattr, vessel, "is_cut_off", False)

        pulled = await _whole(vessel.puller(came=came), here)
        assert vessel.most_under_way <= 8, "more pieces were on their way than there is room for"
        vessel.close()
        return pulled

    pulled = in_virtual_time(steps())
    assert (pulled.sha256, pulled.size, pulled.drops, pulled.is_deleted) == (wanted, 1_000_003, 5, True)
    assert sha256(pulled.path.read_bytes()).hexdigest() == wanted
    assert [path.name for path in there.iterdir()] == ["requests.journal"]
    assert [path.name for path in here.iterdir()] == ["log.mcap"]


async def _whole(puller: LogPuller, folder: Path) -> Pulled:
    logs = await puller.list()
    assert logs == [LogOnboard("log.mcap", 1_000_003, False)]
    return await puller.pull(logs[0], folder)


def test_what_an_interrupted_attempt_has_left_is_not_fetched_again(there: Path, here: Path) -> None:
    async def steps() -> Pulled:
        vessel = Vessel(there)
        first = asyncio.ensure_future(_whole(vessel.puller(), here))
        await asyncio.sleep(1.3)
        first.cancel()
        with pytest.raises(asyncio.CancelledError):
            await first
        left = (here / "log.mcap.1000003.part").stat().st_size
        assert 200_000 < left < 1_000_003
        begun: list[int] = []
        pulled = await _whole(vessel.puller(came=lambda _name, at, _size: begun.append(at)), here)
        assert begun[0] == left
        vessel.close()
        return pulled

    assert in_virtual_time(steps()).is_deleted


def test_what_came_damaged_is_fetched_once_more_and_never_confirmed(there: Path, here: Path) -> None:
    (here / "log.mcap.1000003.part").write_bytes(b"of another log")

    async def steps() -> Pulled:
        vessel, text = Vessel(there), list[str]()
        pulled = await _whole(vessel.puller(text.append), here)
        assert "log.mcap arrived with another digest: once more" in text
        vessel.close()
        return pulled

    assert in_virtual_time(steps()).path.read_bytes()[:3] == Random(0).randbytes(1_000_003)[:3]


def test_a_log_of_another_run_is_not_overwritten(there: Path, here: Path) -> None:
    (here / "log.mcap").write_bytes(b"of the first dive")

    async def steps() -> Pulled:
        vessel = Vessel(there)
        pulled = await _whole(vessel.puller(), here)
        vessel.close()
        return pulled

    pulled = in_virtual_time(steps())
    assert pulled.path.name == f"log-{pulled.sha256[:8]}.mcap"
    assert (here / "log.mcap").read_bytes() == b"of the first dive"


def test_a_log_that_is_pulled_into_the_vehicles_own_folder_is_not_lost(there: Path) -> None:
    wanted = (there / "log.mcap").read_bytes()

    async def steps() -> Pulled:
        vessel = Vessel(there)
        pulled = await _whole(vessel.puller(), there)
        vessel.close()
        return pulled

    assert in_virtual_time(steps()).path.read_bytes() == wanted
    assert sorted(path.name for path in there.iterdir()) == ["log.mcap", "requests.journal"]


def test_only_logs_can_be_fetched_and_only_with_the_right_digest_be_deleted(there: Path, here: Path) -> None:
    async def steps() -> Pulled:
        vessel = Vessel(there)
        puller = vessel.puller()
        for name in ("requests.journal", "../there/log.mcap", "log-9.mcap"):
            with pytest.raises(Gloc3Error, match="there is no log"):
                await puller.pull(LogOnboard(name, 6, False), here)
        with pytest.raises(Refused, match="has another digest here: it is kept"):
            await vessel.station.client.carry_out("auv", ConfirmLog(name="log.mcap", sha256="00"))
        pulled = await puller.pull((await puller.list())[0], here, is_kept=True)
        vessel.close()
        return pulled

    assert not in_virtual_time(steps()).is_deleted
    assert (there / "log.mcap").exists()


def test_a_request_that_comes_twice_ends_one_log(there: Path) -> None:
    cuts: list[int] = []
    shelf = LogStore(there, set, lambda: cuts.append(1), ImmediateExecutor())
    for sequence in (7, 7, 8):
        reply = shelf.handle(CiRequest(sender="255", boot=1, sequence=sequence, body=CutLog()))
        assert reply is not None
        assert reply.outcome is Outcome.ACCEPTED
    assert len(cuts) == 2


def test_a_piece_beyond_the_end_of_a_log_is_empty(there: Path) -> None:
    shelf = LogStore(there, set, lambda: None, ImmediateExecutor())
    for sequence, offset in enumerate((-1, 1_000_003, 1 << 63)):
        shelf.handle(
            CiRequest(sender="255", boot=1, sequence=sequence, body=ReadLog(name="log.mcap", offset=offset, size=9))
        )
    assert [len(chunk.data) for chunk in shelf.collect() if isinstance(chunk, LogChunk)] == [9, 0, 0]


@pytest.mark.parametrize("name", ["../here/log.mcap", "/tmp/log.mcap", ".ssh", "log.mcap/..", 7])
def test_a_platform_cannot_have_a_file_written_elsewhere_by_what_it_calls_its_logs(there: Path, name: object) -> None:
    async def steps() -> list[LogOnboard]:
        vessel = Vessel(there)

        def lie(envelope: Envelope[CiRequest]) -> None:
            assert isinstance(envelope.payload.body, ListLogs)
            logs = [[name, 6, False]]
            vessel.answer(answer(envelope.payload, result={"logs": logs}))

        vessel.is_cut_off = True
        vessel.exchange.subscribe("auv/ci/request", lie)
        try:
            return await vessel.puller().list()
        finally:
            vessel.close()

    with (
        pytest.raises(Refused, match=r"a log with an invalid name|cannot be read"),
        asyncio.Runner(loop_factory=VirtualLoop) as runner,
    ):
        runner.run(steps())
