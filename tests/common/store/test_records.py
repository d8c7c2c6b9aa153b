"""Records that survive: torn at any byte, after a power cut at any time, on disks that are full, slow or broken."""

import errno
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.store import MemoryRecords, RecordFile

RECORDS = [b"first", b"", b"third, which is a little longer", bytes(range(0, 256, 16))]
SOON_S = 30.0


class Disk:
    """Holds every wait for it until it is let go, and fails where it is told to."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.free, self.requested, self.error = threading.Event(), threading.Semaphore(0), 0
        self.free.set()
        patch.setattr(os, "fsync", self._sync)

    def _sync(self, descriptor: int) -> None:
        self.requested.release()
        assert self.free.wait(SOON_S)
        if self.error:
            raise OSError(self.error, os.strerror(self.error))

    @contextmanager
    def busy(self) -> Iterator[None]:
        """So long it does not end."""
        self.requested = threading.Semaphore(0)
        self.free.clear()
        try:
            yield
        finally:
            self.free.set()


@pytest.fixture(autouse=True)
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(monkeypatch)


def made(path: Path, *records: bytes) -> RecordFile:
    """A file with these records, on disk."""
    file = RecordFile(path)
    file.rewrite(list(records))
    assert settled(file)
    return file


def settled(file: RecordFile) -> bool:
    return file.wait(file.mark(), SOON_S)


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.thorough
def test_a_file_torn_at_any_byte_gives_the_records_before_and_takes_new_ones(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    file = made(path)
    newest = tmp_path / "journal.1"
    ends = [newest.stat().st_size]
    for record in RECORDS:
        file.append(record)
        ends.append(newest.stat().st_size)
    data = newest.read_bytes()
    for cut in range(ends[0], len(data) + 1):
        newest.write_bytes(data[:cut])
        whole = sum(end <= cut for end in ends) - 1
        assert RecordFile(path).load() == RECORDS[:whole]
        assert newest.stat().st_size == ends[whole], "the torn end is cut off"
    newest.write_bytes(data[:-1])
    file.load()
    file.append(b"next")
    assert file.load() == [*RECORDS[:3], b"next"]


@settings(max_examples=50)
@given(st.integers(0, 400), st.integers(1, 255))
def test_a_damaged_byte_never_gives_another_record(
    tmp_path_factory: pytest.TempPathFactory, at: int, flip: int
) -> None:
    folder = tmp_path_factory.mktemp("records")
    file = made(folder / "journal")
    for record in RECORDS:
        file.append(record, outlives_power_cut=False)
    data = bytearray((folder / "journal.1").read_bytes())
    data[at % len(data)] ^= flip
    (folder / "journal.1").write_bytes(bytes(data))
    found = RecordFile(folder / "journal").load()
    assert found == RECORDS[: len(found)]
    assert len(found) < len(RECORDS)


def test_a_file_that_is_not_there_has_no_records_and_takes_some(tmp_path: Path) -> None:
    file = RecordFile(tmp_path / "new" / "journal")
    assert file.load() == []
    file.append(b"a")
    assert RecordFile(tmp_path / "new" / "journal").load() == [b"a"]


def test_a_file_that_somebody_has_deleted_is_begun_anew(tmp_path: Path) -> None:
    file = made(tmp_path / "journal", b"a")
    (tmp_path / "journal.1").unlink()
    file.append(b"b")
    file.append(b"c")
    assert RecordFile(tmp_path / "journal").load() == [b"b", b"c"]


def test_rewriting_replaces_everything_and_keeps_to_its_own_files(tmp_path: Path) -> None:
    journal, progress = RecordFile(tmp_path / "kept"), RecordFile(tmp_path / "kept.progress")
    journal.append(b"old")
    journal.rewrite([b"a", b"b"])
    progress.rewrite([b"c"])
    assert settled(journal)
    assert settled(progress)
    assert (journal.load(), progress.load()) == ([b"a", b"b"], [b"c"])
    assert len(files(tmp_path)) == 2


@pytest.mark.thorough
def test_nobody_waits_for_a_slow_disk_and_a_killed_process_has_lost_nothing(tmp_path: Path, disk: Disk) -> None:
    file = made(tmp_path / "progress", b"0")
    with disk.busy():
        for number in range(1, 50):
            file.rewrite([b"%d" % number])
            file.append(b"and more")
            assert RecordFile(tmp_path / "progress").load() == [b"%d" % number, b"and more"]
        assert not file.wait(file.mark(), 0.0)
        assert len(files(tmp_path)) <= 3, "what is neither safe nor on its way is not kept"
    assert settled(file)
    assert files(tmp_path) == ["progress.50"]


@pytest.mark.thorough
def test_a_power_cut_at_any_time_leaves_the_last_that_was_on_disk_or_a_later_one(tmp_path: Path, disk: Disk) -> None:
    path = tmp_path / "progress"
    file = made(path, b"safe")
    with disk.busy():
        file.rewrite([b"on its way", b"of two"])
        assert disk.requested.acquire(timeout=SOON_S)
        file.rewrite([b"newest"])
        whole = {name: (tmp_path / name).read_bytes() for name in files(tmp_path)}
        assert len(whole) == 3
        for torn in ("progress.3", "progress.2"):  # what the disk does not have yet comes back torn, or empty
            for cut in range(len(whole[torn])):
                for name, data in whole.items():
                    (tmp_path / name).write_bytes(data if name < torn else data[:cut] if name == torn else b"")
                found = RecordFile(path).load()
                assert found == ([b"on its way", b"of two"] if torn == "progress.3" else [b"safe"])
        for name, data in whole.items():
            (tmp_path / name).write_bytes(data)
    assert settled(file)
    assert RecordFile(path).load() == [b"newest"]


def test_what_is_found_torn_takes_new_records_behind_the_last_whole_file(tmp_path: Path) -> None:
    made(tmp_path / "progress", b"safe")
    (tmp_path / "progress.2").write_bytes(b"")
    file = RecordFile(tmp_path / "progress")
    assert file.load() == [b"safe"]
    file.append(b"next")
    assert RecordFile(tmp_path / "progress").load() == [b"safe", b"next"]


def test_a_disk_that_fails_is_told_and_asked_once_more(tmp_path: Path, disk: Disk) -> None:
    file = made(tmp_path / "journal", b"a")
    disk.error = errno.EIO
    file.append(b"b")
    assert settled(file)
    for _ in range(2):
        with pytest.raises(OSError, match="Input/output error"):
            file.check()
        assert settled(file)
    disk.error = 0
    with pytest.raises(OSError, match="Input/output error"):
        file.check()
    assert settled(file)
    file.check()


def full(*_: object, **__: object) -> int:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_records_that_do_not_fit_are_told_and_harm_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = made(tmp_path / "journal", b"first")
    attempts: list[tuple[str, Callable[[], None]]] = [
        ("write_bytes", lambda: file.rewrite([b"x"])),
        ("replace", lambda: file.rewrite([b"x"])),
        ("open", lambda: file.append(b"y")),
    ]
    for operation, attempt in attempts:
        with monkeypatch.context() as patch:
            patch.setattr(Path, operation, full)
            with pytest.raises(OSError, match="No space left"):
                attempt()
    file.append(b"second")
    assert file.load() == [b"first", b"second"]


def test_a_record_that_fits_only_in_part_leaves_no_torn_end(tmp_path: Path) -> None:
    import resource

    file = made(tmp_path / "journal", b"first")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, ((tmp_path / "journal.1").stat().st_size + 20, limits[1]))
    try:
        with pytest.raises(OSError, match="no room for 108 bytes"):
            file.append(bytes(100))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    file.append(b"third")
    assert file.load() == [b"first", b"third"]


def test_a_torn_end_is_cut_off_though_there_is_no_room_for_another_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made(tmp_path / "journal", b"first")
    with (tmp_path / "journal.1").open("ab") as stream:
        stream.write(b"\x20\x00")
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        assert RecordFile(tmp_path / "journal").load() == [b"first"]
    file = RecordFile(tmp_path / "journal")
    file.load()
    file.append(b"second")
    assert file.load() == [b"first", b"second"]


@pytest.mark.parametrize("broken", ["read_bytes", "mkdir"])
def test_a_file_that_could_not_be_read_once_does_not_come_back_in_place_of_newer_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, disk: Disk, broken: str
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    before = RecordFile(tmp_path / "state")
    for number in range(3):
        before.rewrite([b"old %d" % number])
        before.wait(before.mark(), SOON_S)
    later = RecordFile(tmp_path / "state")
    with monkeypatch.context() as patch:
        patch.setattr(Path, broken, fail)
        with pytest.raises(OSError, match="Input/output error"):
            later.load()
    with disk.busy():
        later.append(b"new")
        assert RecordFile(tmp_path / "state").load() == [b"new"]
        assert (tmp_path / "state.3").exists(), "the new one is not on disk yet"
    later.append(b"newer")
    assert later.wait(later.mark(), SOON_S)
    assert RecordFile(tmp_path / "state").load() == [b"new", b"newer"]
    assert [path.name for path in tmp_path.iterdir()] == ["state.4"]


def test_records_in_memory_are_those_of_the_process_before() -> None:
    records = MemoryRecords()
    records.append(b"a")
    assert records.load() == [b"a"]
    records.rewrite([b"b"])
    assert records.load() == [b"b"]
