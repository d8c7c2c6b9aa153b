"""What a station keeps on disk: events, MCAP, and a `.tlog` that pymavlink reads; in parts, with the oldest removed."""

import asyncio
import os
from pathlib import Path
from typing import Any

import pytest
from tests.groundstation.scripted_platform import ScriptedPlatform

from gloc3.clock import VIRTUAL_EPOCH_S, Clock, run_virtual
from gloc3.exchange import LocalExchange
from gloc3.log.reader import LogReader
from gloc3.mavlink.codec import Encoder, message
from gloc3.messages.topics import TopicTable
from gloc3_groundstation.desk.events_desk import EventsDesk
from gloc3_groundstation.links.link import LinkContext, StationLinkCore
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store.event_store import EventStore
from gloc3_groundstation.store.recording import RecordingLimits, SessionRecording, default_root, make_room

pytestmark = pytest.mark.thorough


def record(root: Path, seconds: float, limits: RecordingLimits, reported: list[str]) -> Path:
    async def main() -> Path:
        loop = asyncio.get_running_loop()
        exchange, topics = LocalExchange(), TopicTable.installed()
        recording = SessionRecording(root, Clock(loop), loop, topics, "255", reported.append, limits)
        station = Station(exchange, loop, "255", 1)
        store = EventStore(recording.events, Clock(loop).utc_offset_s)
        EventsDesk(station, store)
        recording.attach(exchange)
        sent: list[bytes] = []
        link = StationLinkCore(
            sent.append,
            LinkContext(
                loop=loop, exchange=exchange, topics=topics, boot=1, tap=recording.frame, report=reported.append
            ),
        )
        platform, encoder = ScriptedPlatform(exchange), Encoder(1, 1)
        platform.speak_every(0.5)
        for number in range(int(seconds)):
            await asyncio.sleep(1.0)
            link.receive(encoder.encode(message("ATTITUDE", time_boot_ms=number)))
            platform.event(f"second {number}")
        platform.is_deaf = True
        station.close()
        link.close()
        recording.close()
        store.close()
        return recording.folder

    return run_virtual(main())


def frames(tlog: Path) -> list[Any]:
    """The frames of a `.tlog`, read by another program's library."""
    from pymavlink import mavutil

    log, found = mavutil.mavlink_connection(str(tlog)), []
    while (one := log.recv_match()) is not None:
        found.append(one)
    log.close()
    return found


@pytest.mark.thorough
def test_everything_is_in_the_three_logs_and_other_programs_read_them(tmp_path: Path) -> None:
    reported: list[str] = []
    folder = record(tmp_path, 5.0, RecordingLimits(), reported)
    assert folder.name == "2026-01-01_00-00-00"
    assert sorted(path.name for path in folder.iterdir()) == ["events.jsonl", "links.tlog", "station.mcap"]
    received = frames(folder / "links.tlog")
    assert [one.time_boot_ms for one in received if one.get_type() == "ATTITUDE"] == [0, 1, 2, 3, 4]
    beats = [one for one in received if one.get_type() == "HEARTBEAT"]
    assert {one.get_srcSystem() for one in beats} == {255}, "what is sent is in it too"
    assert beats[0]._timestamp == pytest.approx(VIRTUAL_EPOCH_S, abs=1.1)
    assert "second 4" in (folder / "events.jsonl").read_text()
    with LogReader(folder / "station.mcap") as log:
        topics = set(log.topics)
    assert {"heron/ci/summary", "heron/ci/vehicle", "heron/ci/event", "heron/ci/request"} <= topics
    assert reported == []


def test_logs_are_cut_into_parts_and_the_oldest_make_room(tmp_path: Path) -> None:
    previous = tmp_path / "2020-01-01_00-00-00"
    previous.mkdir()
    (previous / "links.tlog").write_bytes(b"x" * 50_000)
    (previous / "notes.txt").write_text("a person's own")
    os.utime(previous / "links.tlog", (1.0, 1.0))
    folder = record(tmp_path, 60.0, RecordingLimits(part_bytes=500, kept_bytes=40_000), [])
    parts = [path.name for path in folder.iterdir()]
    numbers = [int(name.partition("-")[2].partition(".")[0]) for name in parts if "-" in name]
    assert max(numbers) > 50
    assert min(numbers) > 3, "the oldest are gone"
    assert sum(path.stat().st_size for path in folder.iterdir()) < 60_000, "and what is being written"
    assert [path.name for path in previous.iterdir()] == ["notes.txt"]


def test_what_is_being_written_never_makes_room(tmp_path: Path) -> None:
    for name in ("a.tlog", "b.tlog"):
        (tmp_path / "run").mkdir(exist_ok=True)
        (tmp_path / "run" / name).write_bytes(b"x" * 100)
    make_room(tmp_path, 0, {tmp_path / "run" / "a.tlog"})
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["a.tlog"]


def test_a_disk_that_takes_no_more_is_told_once_and_the_station_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reported: list[str] = []

    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "open", fail)
    with pytest.raises(Exception, match="No space left on device"):
        record(tmp_path, 1.0, RecordingLimits(), reported)
    monkeypatch.undo()
    opened = Path.open

    def fail_later(path: Path, *arguments: Any, **options: Any) -> Any:
        return fail() if "-2" in path.stem and path.suffix == ".tlog" else opened(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", fail_later)
    record(tmp_path, 30.0, RecordingLimits(part_bytes=500), reported)
    assert len(reported) == 1
    assert reported[0].startswith("recording: cannot write")


def test_the_folder_is_that_of_the_desktop_standard() -> None:
    assert default_root({"XDG_STATE_HOME": "/state"}) == Path("/state/gloc3/station")
    assert default_root({"HOME": "/home/op"}) == Path("/home/op/.local/state/gloc3/station")
    assert default_root({"HOME": "/home/op", "XDG_STATE_HOME": "relative"}).is_relative_to("/home/op")
