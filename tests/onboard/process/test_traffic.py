"""What the onboard process keeps of its MAVLink links."""

import asyncio
import os
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from threading import Event

import pytest

from gloc3.clock import Clock, run_virtual
from gloc3.errors import Refused
from gloc3.log.reader import LogReader
from gloc3.log.record import Recorder
from gloc3.mavlink.codec import Encoder, message
from gloc3.mavlink.tlog import OVERHEAD_BYTES
from gloc3.messages.topics import TopicTable
from gloc3_onboard.process.run_log import Traffic

STATION = Encoder(255, 190)


def waiting(disk: Event, write: Callable[[bytes], None]) -> Callable[[bytes], None]:
    """What writes when the disk takes it."""

    def write_late(data: bytes) -> None:
        assert disk.wait(30.0)
        write(data)

    return write_late


def keep(folder: Path, tlog: Path, *frames: bytes, disk: Event | None = None) -> list[str]:
    """Keeps frames, one each second; gives the warnings. A disk takes nothing until all have been kept."""
    warnings: list[str] = []

    async def work() -> None:
        loop = asyncio.get_running_loop()
        clock = Clock(loop)
        recorder = Recorder(folder / "log.mcap", clock, TopicTable.installed(), {})
        with closing(recorder):
            traffic = Traffic(tlog, recorder, clock, loop, warnings.append)
            if disk is not None:
                traffic._file._write = waiting(disk, traffic._file._write)  # type: ignore[method-assign, assignment]
            for frame in frames:
                traffic.record_frame("radio", "in", frame)
                await asyncio.sleep(1.0)
            if disk is not None:
                assert tlog.stat().st_size == 0
                disk.set()
            warnings.extend(filter(None, [traffic.close()]))

    run_virtual(work())
    return warnings


def test_keys_are_not_kept(tmp_path: Path) -> None:
    key = bytes(range(1, 33))
    heartbeat = STATION.encode(message("HEARTBEAT"))
    secret = STATION.encode(message("SETUP_SIGNING", secret_key=key, initial_timestamp=1))
    assert keep(tmp_path, tmp_path / "log.tlog", heartbeat, secret, heartbeat) == []
    assert key not in (tmp_path / "log.tlog").read_bytes()
    assert (tmp_path / "log.tlog").stat().st_size == 2 * (OVERHEAD_BYTES + len(heartbeat))
    with LogReader(tmp_path / "log.mcap") as reader:
        assert [frame.data for frame in reader.frames()] == [heartbeat, heartbeat]


def test_nobody_waits_for_a_disk_and_everything_is_there_in_the_end(tmp_path: Path) -> None:
    heartbeat = STATION.encode(message("HEARTBEAT"))
    assert keep(tmp_path, tmp_path / "log.tlog", *[heartbeat] * 5, disk=Event()) == []
    assert (tmp_path / "log.tlog").stat().st_size == 5 * (OVERHEAD_BYTES + len(heartbeat))


def test_a_full_disk_is_told_once_and_the_data_log_goes_on(tmp_path: Path) -> None:
    heartbeat = STATION.encode(message("HEARTBEAT"))
    (warning,) = keep(tmp_path, Path("/dev/full"), *[heartbeat] * 5)
    assert "/dev/full" in warning
    assert os.strerror(28) in warning
    with LogReader(tmp_path / "log.mcap") as reader:
        assert len(list(reader.frames())) == 5


def test_a_folder_in_its_place_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="directory"):
        keep(tmp_path, tmp_path)
