"""Logs are fetched over a real network session that breaks off five times, and deleted onboard only by who may."""

import asyncio
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from hashlib import sha256
from pathlib import Path
from random import Random

import pytest
from tests.common.network.yard import Yard, free_port
from tests.groundstation.scripted_platform import VEHICLE
from tests.onboard.hosts.relay import Connections

from gloc3.exchange import LocalExchange, Publisher
from gloc3.exchange.zenoh import ZenohExchange
from gloc3.messages.command_interface import AboutLogs, CiRequest, LogChunk
from gloc3.messages.envelope import Envelope
from gloc3.messages.topics import TopicTable
from gloc3.network.stations import join_platforms
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

    def __init__(self, yard: Yard, network: ZenohExchange, folder: Path, workers: ThreadPoolExecutor) -> None:
        self._loop = asyncio.get_running_loop()
        self.chunks = 0
        self._log_store = LogStore(folder, set, lambda: None, workers)
        self._publisher = Publisher(network, "pelican", "command_server", 1)
        self._bridge = yard.bridge(network, lambda *reported: pytest.fail(str(reported)))
        self._undo = network.subscribe("pelican/ci/request", self._take)
        self._due_s = 0.0
        self._tick()

    def _tick(self) -> None:
        self._timer = self._loop.call_later(0.005, self._tick)
        if self._loop.time() >= self._due_s:
            self._due_s = self._loop.time() + 0.1
            self._publisher.publish("pelican/ci/vehicle", VEHICLE, self._loop.time())
        for reported in self._log_store.collect():
            self.chunks += isinstance(reported, LogChunk)
            self._publisher.publish(
                f"pelican/{'log_chunk' if isinstance(reported, LogChunk) else 'ci/reply'}", reported, self._loop.time()
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
                part = join_platforms(network, exchange, topics, "alice", signer=yard.membership("alice").signer())
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
