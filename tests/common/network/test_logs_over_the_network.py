"""Logs are fetched over a real network session that breaks off five times, and deleted onboard only by who may."""

import asyncio
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, asynccontextmanager, suppress
from hashlib import sha256
from pathlib import Path
from random import Random

import pytest
from tests.common.exchange.middlewares import until
from tests.common.network.yard import LONG, NOW, Yard, free_port
from tests.groundstation.scripted_platform import VEHICLE
from tests.onboard.hosts.relay import Connections

from gloc3.exchange import LocalExchange, Publisher
from gloc3.exchange.zenoh import ZenohExchange
from gloc3.messages.command_interface import AboutLogs, CiRequest, LogChunk
from gloc3.messages.envelope import Envelope
from gloc3.messages.topics import TopicTable
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.network.stations import join_platforms
from gloc3_groundstation.cli.log_pull import PullRequest, _pull_many
from gloc3_groundstation.desk import flights
from gloc3_groundstation.station import snapshots
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store import log_pull
from gloc3_groundstation.store.log_pull import ChunkCarrier, LogPuller
from gloc3_onboard.command_server.log_shelf import LogStore

pytestmark = [pytest.mark.sockets, pytest.mark.timeout(40)]
SIZE = 4_000_003


class Vessel:
    """A platform's shelf of logs on the network, for whoever asks."""

    def __init__(
        self,
        yard: Yard,
        network: ZenohExchange,
        folder: Path,
        workers: ThreadPoolExecutor,
        platform: str = "pelican",
    ) -> None:
        self._loop, self._platform = asyncio.get_running_loop(), platform
        self.chunks = 0
        self._log_store = LogStore(folder, set, lambda: None, workers)
        self._publisher = Publisher(network, platform, "command_server", 1)
        self._bridge = yard.bridge(network, lambda *reported: pytest.fail(str(reported)), platform)
        self._undo = network.subscribe(f"{platform}/ci/request", self._take)
        self._due_s = 0.0
        self._tick()

    def _tick(self) -> None:
        self._timer = self._loop.call_later(0.005, self._tick)
        if self._loop.time() >= self._due_s:
            self._due_s = self._loop.time() + 0.1
            self._publisher.publish(f"{self._platform}/ci/vehicle", VEHICLE, self._loop.time())
        for reported in self._log_store.collect():
            self.chunks += isinstance(reported, LogChunk)
            self._publisher.publish(
                f"{self._platform}/{'log_chunk' if isinstance(reported, LogChunk) else 'ci/reply'}",
                reported,
                self._loop.time(),
            )

    def _take(self, envelope: Envelope[CiRequest]) -> None:
        if isinstance(envelope.payload.body, AboutLogs):
            self._log_store.handle(envelope.payload)

    def close(self) -> None:
        self._timer.cancel()
        self._undo()
        self._bridge.close()


@asynccontextmanager
async def relayed(yard: Yard, member: str) -> AsyncIterator[Connections]:
    """A relay by which a member reaches the platform in place of the straight way."""
    host, _, port = yard.address.rpartition(":")
    relay, own = Connections((host, int(port))), free_port()
    server = await asyncio.start_server(relay.serve, "127.0.0.1", own)
    file = yard.folder / member / "network.yaml"
    file.write_text(file.read_text().replace(yard.address, f"127.0.0.1:{own}"))
    try:
        yield relay
    finally:
        server.close()
        relay.obey("reset")


async def test_a_log_comes_over_a_session_that_breaks_off_five_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (("LOST_S", 0.8), ("CHUNK_S", 0.4), ("TRY_AGAIN_S", 0.2)):
        monkeypatch.setattr(log_pull, name, value)
    monkeypatch.setattr(snapshots, "QUIET_LINK_S", 0.6)
    there, here = tmp_path / "there", tmp_path / "here"
    there.mkdir()
    here.mkdir()
    (there / "log.mcap").write_bytes(Random(7).randbytes(SIZE))
    wanted = sha256((there / "log.mcap").read_bytes()).hexdigest()
    yard, topics, loop = Yard(tmp_path / "yard"), TopicTable.installed(), asyncio.get_running_loop()
    with ThreadPoolExecutor(2) as workers:
        async with relayed(yard, "alice") as relay:
            with yard.open("pelican.main") as main, yard.open("alice") as network:
                vessel, exchange = Vessel(yard, main, there, workers), LocalExchange(topics)
                part = join_platforms(
                    network, exchange, topics, "alice", signer=yard.membership("alice").signer(), unsent=pytest.fail
                )
                station = Station(exchange, loop, "alice", 9)
                breaks = [SIZE * number // 6 for number in range(1, 6)]

                def came(_: str, at: int, __: int) -> None:
                    if breaks and at >= breaks[0]:
                        breaks.pop(0)
                        relay.obey("partition")
                        relay.obey("reset")
                        loop.call_later(1.0, relay.obey, "heal")

                puller = LogPuller(station, "pelican", ChunkCarrier(station, exchange, "pelican"), came)
                assert await flights.await_platform(station, None) == "pelican"
                (log,) = await puller.list()
                pulled = await puller.pull(log, here)
                station.close()
                part()
                vessel.close()
    assert not breaks
    assert pulled.drops >= 5
    assert (pulled.sha256, pulled.size, pulled.is_deleted) == (wanted, SIZE, True)
    assert sha256((here / "log.mcap").read_bytes()).hexdigest() == wanted
    assert list(there.iterdir()) == []
    assert vessel.chunks * log_pull.CHUNK_BYTES < 2 * SIZE, "what had come was fetched again"


async def test_logs_of_many_vehicles_come_at_once_and_the_same_command_resumes_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    yard, here = Yard(tmp_path / "yard"), tmp_path / "here"
    heron = register.NetworkMember(
        role=MemberRole.PLATFORM, certificate="", until="", listen=[f"127.0.0.1:{free_port()}"]
    )
    register.add(yard.folder, "heron.main", heron, NOW, LONG, is_renewed=False)
    wanted = PullRequest(names=("log.mcap",), is_uncut=True, is_kept=True, out=here, is_many=True)
    data = {name: Random(name).randbytes(SIZE) for name in ("pelican", "heron")}

    async def pull() -> int:
        return await _pull_many(str(yard.folder / "alice" / "network.yaml"), [], wanted, 10.0, 254, None)

    with ThreadPoolExecutor(2) as workers, ExitStack() as stack:
        vessels = []
        for name, content in data.items():
            (tmp_path / name).mkdir()
            (tmp_path / name / "log.mcap").write_bytes(content)
            network = stack.enter_context(yard.open(f"{name}.main"))
            vessels.append(Vessel(yard, network, tmp_path / name, workers, name))
        first = asyncio.create_task(pull())
        parts = [here / name / f"log.mcap.{SIZE}.part" for name in data]
        await until(lambda: all(part.exists() and part.stat().st_size > SIZE // 10 for part in parts), 20.0)
        first.cancel()
        with suppress(asyncio.CancelledError):
            await first
        assert all(part.stat().st_size < SIZE for part in parts), "both were under way"
        assert await pull() == 0
        chunks = sum(vessel.chunks for vessel in vessels)
        for vessel in vessels:
            vessel.close()
    told = capsys.readouterr()
    for name, content in data.items():
        assert (here / name / "log.mcap").read_bytes() == content
        assert f"{name}/log.mcap: resumes at" in told.err
        assert f"{name}/log.mcap: 4.0 MB, digest equal, left onboard" in told.err
        assert str(here / name / "log.mcap") in told.out
    assert chunks * log_pull.CHUNK_BYTES < 3 * SIZE, "what had come was not fetched again"
