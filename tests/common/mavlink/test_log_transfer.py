"""Logs are listed and read whole, whatever is lost in transit."""

import random
from collections.abc import Sequence

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.codec import message
from gloc3.mavlink.services.files.log_client import LogClient, LogDownload, LogList, LogResult
from gloc3.mavlink.services.files.log_server import LogEntry, LogServer
from gloc3.mavlink.transport.memory import Conditions

from .pair import STATION, VEHICLE, Pair


class MemoryLogs:
    """Logs in memory."""

    def __init__(self, sizes: Sequence[int], first: int = 1) -> None:
        chance = random.Random(1)
        self.contents = {number: chance.randbytes(size) for number, size in enumerate(sizes, start=first)}

    def entries(self) -> list[LogEntry]:
        return [LogEntry(number, len(content), 1_700_000_000) for number, content in self.contents.items()]

    def read(self, number: int, offset: int, size: int) -> bytes:
        if number not in self.contents:
            raise FileNotFoundError(number)
        return self.contents[number][offset : offset + size]

    def erase(self) -> None:
        self.contents.clear()


def wired(logs: MemoryLogs, loss: float = 0.0, *, may_erase: bool = False) -> tuple[Pair, LogServer, LogClient]:
    pair = Pair(1, Conditions(latency_s=0.02, loss=loss))
    server, client = LogServer(VEHICLE, logs, may_erase=may_erase), LogClient(STATION)
    pair.add([server], [client])
    return pair, server, client


def finish(pair: Pair, wanted: LogList | LogDownload) -> LogResult | None:
    pair.run(300.0, lambda: wanted.result is not None)
    return wanted.result


@pytest.mark.parametrize("loss", [0.0, 0.2])
@pytest.mark.parametrize("first", [0, 1, 7])
def test_logs_are_listed_and_read(loss: float, first: int) -> None:
    logs = MemoryLogs([10_000, 0, 90, 91, 5], first)
    pair, _, client = wired(logs, loss)
    listing = client.list(VEHICLE, now_s=0.0)
    assert finish(pair, listing) is LogResult.DONE
    assert sorted(listing.entries.values(), key=lambda entry: entry.number) == logs.entries()
    for entry in logs.entries():
        download = client.read(VEHICLE, entry, now_s=pair.now_s)
        assert finish(pair, download) is LogResult.DONE
        assert download.data == logs.contents[entry.number]
        assert download.progress == 1.0
    assert pair.now_s < 60.0


def test_no_logs_are_an_empty_list() -> None:
    pair, _, client = wired(MemoryLogs([]), 0.3)
    listing = client.list(VEHICLE, now_s=0.0)
    assert finish(pair, listing) is LogResult.DONE
    assert listing.entries == {}


def test_a_log_does_not_flood_the_link_and_stops_when_it_is_told_to() -> None:
    server = LogServer(VEHICLE, MemoryLogs([1_000_000]), pieces_per_s=100.0)
    server.receive(message("LOG_REQUEST_DATA", target_system=1, id_=1, count=1_000_000), STATION, 0.0)
    for step in range(1000):
        server.tick(step * 0.001)
    assert 95 <= len(server.outgoing()) <= 105
    server.receive(message("LOG_REQUEST_END", target_system=1), STATION, 1.0)
    server.tick(2.0)
    assert server.outgoing() == []
    assert server.next_tick_s() is None


def test_a_download_may_be_cancelled_and_only_one_thing_runs_at_a_time() -> None:
    pair, server, client = wired(MemoryLogs([100_000]))
    download = client.read(VEHICLE, LogEntry(1, 100_000), now_s=0.0)
    with pytest.raises(Refused, match="being listed or read"):
        client.list(VEHICLE, now_s=0.0)
    pair.run(1.0)
    assert 0.0 < download.progress < 1.0
    client.cancel()
    assert download.result is LogResult.CANCELLED
    pair.run(1.0)
    assert server.next_tick_s() is None
    with pytest.raises(Refused, match="too large"):
        client.read(VEHICLE, LogEntry(1, 1 << 30), now_s=0.0)


def test_nobody_there_and_a_log_that_is_gone_are_told() -> None:
    pair, _, client = wired(MemoryLogs([]), 1.0)
    assert finish(pair, client.list(VEHICLE, now_s=0.0)) is LogResult.NO_ANSWER
    pair, _, client = wired(MemoryLogs([100]))
    assert finish(pair, client.read(VEHICLE, LogEntry(9, 100), now_s=0.0)) is LogResult.TOO_MANY_LOSSES


def test_logs_are_erased_only_where_that_is_allowed() -> None:
    for may_erase in (False, True):
        logs = MemoryLogs([10])
        pair, _, client = wired(logs, may_erase=may_erase)
        client.erase_all(VEHICLE)
        pair.run(1.0)
        assert (logs.contents == {}) is may_erase


@pytest.mark.parametrize("begun", [0, 1, 89, 90, 5000, 9_999, 10_000, 20_000])
def test_what_is_here_already_is_not_asked_for_again(begun: int) -> None:
    logs = MemoryLogs([10_000])
    pair, _, client = wired(logs, 0.1)
    entry = logs.entries()[0]
    first = (logs.contents[1] + bytes(20_000))[:begun]
    download = client.read(VEHICLE, entry, now_s=0.0, begun=first)
    assert download.whole_bytes == (10_000 if begun >= 10_000 else begun // 90 * 90)
    assert finish(pair, download) is LogResult.DONE
    assert download.data == logs.contents[1]
    assert download.whole_bytes == 10_000
    assert (pair.link.a.sent == 0) == (begun >= 10_000)
