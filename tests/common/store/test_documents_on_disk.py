"""Small files that are replaced whole: after a power cut, in foreign hands, on full disks and in missing folders."""

import errno
import os
import tempfile
import threading
from pathlib import Path

import pytest

from gloc3.store import AppendFile, DocumentFile, replace_file

SOON_S = 30.0


def document(path: Path) -> DocumentFile[dict[str, int]]:
    return DocumentFile(path, dict[str, int])


def settle() -> None:
    """Waits until no file is on its way to the disk."""
    for thread in threading.enumerate():
        if thread.name.startswith("disk:"):
            thread.join(SOON_S)


def test_what_was_written_is_there_in_plain_json_in_a_folder_that_was_missing(tmp_path: Path) -> None:
    path = tmp_path / "new" / "shown.json"
    file = document(path)
    assert file.read() is None
    file.write({"heron": 3})
    assert path.read_bytes() == b'{"heron":3}'
    assert document(path).read() == {"heron": 3}
    assert file.problem == ""
    settle()
    assert [one.name for one in path.parent.iterdir()] == ["shown.json"]


def test_nobody_waits_for_the_disk_and_a_power_cut_at_any_byte_leaves_the_value_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, free = tmp_path / "shown.json", threading.Event()
    file = document(path)
    file.write({"heron": 1})
    settle()
    monkeypatch.setattr(os, "fsync", lambda _: free.wait(SOON_S))
    for number in (2, 3):  # neither is on disk
        file.write({"heron": number})
        assert document(path).read() == {"heron": number}, "a process that is killed has lost nothing"
    data = path.read_bytes()
    for cut in range(len(data)):
        path.write_bytes(data[:cut])
        assert document(path).read() == {"heron": 1}
    path.write_bytes(data)
    free.set()
    settle()
    assert document(path).read() == {"heron": 3}
    assert [one.name for one in tmp_path.iterdir()] == ["shown.json"]


def test_the_same_value_is_not_written_twice(tmp_path: Path) -> None:
    path = tmp_path / "shown.json"
    document(path).write({"heron": 1})
    again = document(path)
    again.read()
    before = path.stat().st_mtime_ns, path.stat().st_ino
    again.write({"heron": 1})
    assert (path.stat().st_mtime_ns, path.stat().st_ino) == before


@pytest.mark.parametrize("foreign", [b"", b"{", b"\xff\xfe", b'{"heron": "three"}', b"[1, 2]"])
def test_foreign_bytes_are_reported_and_replaced_by_the_next_value(tmp_path: Path, foreign: bytes) -> None:
    path = tmp_path / "shown.json"
    path.write_bytes(foreign)
    file = document(path)
    assert file.read() is None
    assert "shown.json cannot be read" in file.problem
    file.write({"heron": 4})
    assert (file.problem, document(path).read()) == ("", {"heron": 4})


def test_a_full_disk_is_reported_and_the_value_is_written_once_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "shown.json"
    file = document(path)
    file.write({"heron": 1})

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        file.write({"heron": 2})
        assert file.problem.endswith("shown.json cannot be written: No space left on device")
        assert document(path).read() == {"heron": 1}
    file.write({"heron": 2})
    assert (file.problem, document(path).read()) == ("", {"heron": 2})


def test_a_folder_that_cannot_be_made_is_reported(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file, not a folder")
    file = document(tmp_path / "taken" / "shown.json")
    file.read()
    file.write({"heron": 1})
    assert "cannot be written" in file.problem


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "unit"
    replace_file(path, b"first")
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(OSError(errno.EIO, "broken")))
        with pytest.raises(OSError, match="broken"):
            replace_file(path, b"second")
    assert path.read_bytes() == b"first"


def test_what_is_appended_in_part_is_cut_off_and_read_by_its_place() -> None:
    import resource

    with tempfile.TemporaryFile(buffering=0) as stream:
        file = AppendFile(stream)
        file.append(b"first ")
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (10, limits[1]))
        try:
            with pytest.raises(OSError, match="no room for 100 bytes"):
                file.append(bytes(100))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        file.append(b"third")
        assert (file.size, file.read(6, 5), file.read(0, 99)) == (11, b"third", b"first third")
