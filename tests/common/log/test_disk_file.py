"""A log's file while its disk is slow, full, or both."""

import os
import resource
from pathlib import Path
from threading import Event

import pytest

from gloc3.log import disk_file
from gloc3.log.disk_file import DiskFile


def held(file: DiskFile, monkeypatch: pytest.MonkeyPatch) -> Event:
    """What lets a disk take something that takes nothing until then."""
    may_write, write = Event(), file._write

    def write_late(data: bytes) -> None:
        assert may_write.wait(30.0)
        write(data)

    monkeypatch.setattr(file, "_write", write_late)
    return may_write


def test_everything_is_there_in_order_and_nobody_waited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = DiskFile(tmp_path / "log")
    may_write = held(file, monkeypatch)
    parts = [bytes([number]) * number for number in range(1, 200)]
    for part in parts:
        file.write(part)
        file.flush()
    assert (tmp_path / "log").stat().st_size == 0
    may_write.set()
    file.write(b"end")
    file.close()
    assert (tmp_path / "log").read_bytes() == b"".join(parts) + b"end"


def test_a_disk_that_is_far_too_slow_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disk_file, "MOST_WAITING", 1_000_000)
    file = DiskFile(tmp_path / "log")
    may_write = held(file, monkeypatch)
    file.write(bytes(900_000))
    file.flush()
    file.write(bytes(200_000))
    with pytest.raises(OSError, match="the disk is too slow: 1 MB are waiting"):
        file.flush()
    may_write.set()
    with pytest.raises(OSError, match="too slow"):
        file.close()


def test_a_disk_that_is_full_is_told_and_what_it_took_stays(tmp_path: Path) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        file = DiskFile(tmp_path / "log")
        file.write(bytes(1500))
        file.flush()
        with pytest.raises(OSError, match=os.strerror(27)):
            file.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (tmp_path / "log").stat().st_size == 1000
