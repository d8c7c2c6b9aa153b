"""The log of a run over several files: nothing is lost between them, and the oldest go when there is no room."""

import asyncio
import os
from pathlib import Path

import pytest

from gloc3.clock import Clock
from gloc3.errors import Refused
from gloc3.exchange import LocalExchange, Publisher
from gloc3.log.description import RunDescription
from gloc3.log.foxglove.layout import LAYOUT_FILE
from gloc3.log.reader import LogReader
from gloc3.log.record import CAMERAS_FILE, PLATFORM_FILE, RUN
from gloc3.messages.envelope import Event, Severity
from gloc3.messages.topics import TopicTable
from gloc3.platform.platform import Platform, Vehicle
from gloc3_onboard.process import run_log
from gloc3_onboard.process.log_files import LogFiles
from gloc3_onboard.process.run_log import CONTINUES, LogLimits, RunLog

pytestmark = pytest.mark.thorough


DESCRIPTION = RunDescription(
    Platform(platform="bench", vehicle=Vehicle(type="quadrotor", mass_kg=1.0), log={"pose": False}),
    "platform: bench\n",
    {},
)


def texts(path: Path) -> list[str]:
    with LogReader(path) as reader:
        assert reader.is_finished
        assert list(reader.attachments) == [PLATFORM_FILE, CAMERAS_FILE]
        return [entry.envelope.payload.text for entry in reader.entries("components/talker/event")]


def touched(folder: Path, *names: str) -> LogFiles:
    for name in names:
        (folder / name).write_bytes(b"." * 1000)
    return LogFiles(folder)


async def test_a_file_that_has_grown_large_is_followed_by_the_next_and_every_message_is_in_one_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_log, "POLL_PERIOD_S", 0.02)
    loop, exchange, said = asyncio.get_running_loop(), LocalExchange(), list[str]()
    talker = Publisher(exchange, "bench", "talker", 1)
    log = RunLog(
        LogFiles(tmp_path),
        LogLimits(file_mb=0.002, total_mb=0.0),
        Clock(loop),
        TopicTable.installed(),
        exchange,
        loop,
        {"platform": "bench"},
        DESCRIPTION,
        list,
        lambda _, text: said.append(text),
    )
    count = 0
    while log.path.name != "log-4.mcap":
        talker.publish("bench/components/talker/event", Event(severity=Severity.INFO, text=f"{count}"), loop.time())
        log.record_frame("a", "in", bytes(range(1, 200)))
        count += 1
        await asyncio.sleep(0.005)
        assert count < 5000
    await log.close()
    found = [text for number in ("", "-2", "-3", "-4") for text in texts(tmp_path / f"log{number}.mcap")]
    assert found == [f"{number}" for number in range(count)]
    with LogReader(tmp_path / "log-3.mcap") as reader:
        assert (reader.metadata(RUN) or {})[CONTINUES] == "log-2.mcap"
    assert said == []


async def test_logs_beyond_the_total_are_deleted_from_the_oldest_on_but_nothing_else(tmp_path: Path) -> None:
    files = touched(
        tmp_path, "log.mcap", "log.tlog", "log-2.mcap", "log-3.mcap", "log-10.mcap", "log-front-2.mcap", "log-4.txt"
    )
    assert [path.name for path in files.prune(3500)] == ["log.mcap", "log.tlog", "log-2.mcap"]
    assert files.next().name == "log-11.mcap", "a number is not used again"
    assert files.prune(0) == [tmp_path / "log-3.mcap"], "the last one is being written"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log-10.mcap", "log-4.txt", "log-front-2.mcap"]


def test_a_stem_of_its_own_has_its_own_numbers(tmp_path: Path) -> None:
    touched(tmp_path, "log-7.mcap", "log-front.mcap")
    assert LogFiles(tmp_path, "log-front").next().name == "log-front-2.mcap"
    assert LogFiles(tmp_path, "log-rear").next().name == "log-rear.mcap"


def test_the_oldest_logs_of_all_processes_go_but_never_the_last_of_one(tmp_path: Path) -> None:
    names = (
        "log-rear.mcap",
        "log-front.mcap",
        "log-rear-2.mcap",
        "log-front-2.mcap",
        "log-front-2.tlog",
        "log-front-3.mcap",
    )
    touched(tmp_path, *names)
    (tmp_path / "map.yaml").write_bytes(b"." * 9000)
    for second, name in enumerate(names):
        os.utime(tmp_path / name, (second, second))
    assert [path.name for path in LogFiles(tmp_path, "log-rear").prune(4500)] == ["log-rear.mcap", "log-front.mcap"]
    removed = LogFiles(tmp_path, "log-front").prune(0)
    assert [path.name for path in removed] == ["log-front-2.mcap", "log-front-2.tlog"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log-front-3.mcap", "log-rear-2.mcap", "map.yaml"]


class FullDisk(LogFiles):
    """Logs on a disk without room."""

    def next(self) -> Path:
        return self.folder / "log.mcap"


async def test_a_full_disk_names_every_log_that_has_stopped(tmp_path: Path) -> None:
    for name in ("log.mcap", "log.tlog"):
        (tmp_path / name).symlink_to("/dev/full")
    loop, exchange, said = asyncio.get_running_loop(), LocalExchange(), list[str]()
    files = FullDisk(tmp_path)
    report = lambda _, text: said.append(text)  # noqa: E731 # as above
    log = RunLog(files, LogLimits(), Clock(loop), TopicTable.installed(), exchange, loop, {}, None, list, report)
    log.record_frame("a", "in", bytes(range(1, 200)))
    for _ in range(100):
        await asyncio.sleep(0.05)
        if log.problem.count("No space left") == 2:
            break
    assert "log.mcap: " in log.problem
    assert "log.tlog: " in log.problem
    await log.close()


async def test_how_fast_the_log_grows_is_measured_over_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_log, "POLL_PERIOD_S", 0.05)
    loop, exchange = asyncio.get_running_loop(), LocalExchange()
    log = RunLog(
        LogFiles(tmp_path), LogLimits(), Clock(loop), TopicTable.installed(), exchange, loop, {}, None, list,
        lambda _, text: None,
    )  # fmt: skip
    assert log.mb_per_min == 0.0
    begin_s, sent = loop.time(), 0
    for index in range(40):
        log.record_frame("a", "in", os.urandom(20_000))
        sent += 2 * 20_000  # into the log, and beside it
        if index == 20:
            log.cut()
        await asyncio.sleep(0.05)
    expected = sent / 1e6 * 60.0 / (loop.time() - begin_s)
    assert log.mb_per_min == pytest.approx(expected, rel=0.6)
    await log.close()


async def test_what_the_log_records_is_changed_for_later_files_too(tmp_path: Path) -> None:
    loop, exchange = asyncio.get_running_loop(), LocalExchange()
    topics = TopicTable.installed()
    log = RunLog(
        LogFiles(tmp_path), LogLimits(), Clock(loop), topics, exchange, loop, {}, DESCRIPTION, list, lambda _, text: None,
        has_links=False,
    )  # fmt: skip
    talker = Publisher(exchange, "bench", "talker", 1)
    event = Event(severity=Severity.INFO, text="said")
    assert log.select({"components/*/event": False}) == {"pose": False, "components/*/event": False}
    talker.publish("bench/components/talker/event", event, loop.time())
    log.cut()
    talker.publish("bench/components/talker/event", event, loop.time())
    with pytest.raises(Refused, match="no topic fits"):
        log.select({"poses": True})
    log.select({"components/*/event": True})
    talker.publish("bench/components/talker/event", event, loop.time())
    await log.close()
    counts = []
    for name in ("log.mcap", "log-2.mcap"):
        with LogReader(tmp_path / name) as reader:
            counts.append(len(list(reader.entries("components/*/event"))))
    assert counts == [0, 1]


async def test_a_layout_that_cannot_be_written_stops_nothing(tmp_path: Path) -> None:
    (tmp_path / LAYOUT_FILE).symlink_to("/dev/full")
    loop, exchange, said = asyncio.get_running_loop(), LocalExchange(), list[str]()
    log = RunLog(
        LogFiles(tmp_path), LogLimits(), Clock(loop), TopicTable.installed(), exchange, loop, {}, DESCRIPTION, list,
        lambda _, text: said.append(text),
    )  # fmt: skip
    assert said == ["the layout for Foxglove cannot be written: No space left on device"]
    assert log.problem == ""
    await log.close()
    assert texts(tmp_path / "log.mcap") == []
