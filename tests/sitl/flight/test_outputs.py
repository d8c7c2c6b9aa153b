"""The folder of a flight: an earlier flight's files go, everything else stays."""

import errno
import os
from pathlib import Path

import pytest

from gloc3.errors import Refused
from gloc3_sitl.flight.outputs import recreate


def test_what_an_earlier_flight_left_goes_and_what_is_somebody_elses_stays(tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "images").mkdir(parents=True)
    ours = [
        "log.mcap",
        "log.tlog",
        "flight_001.ulg",
        "report.json",
        "requests.journal.3",
        "events.store.new",
        "images/ground-00001.jpg",
        "images/poses.jsonl",
    ]
    theirs = ["mission.yaml", "notes.txt", "images/holiday.png", "log-2.mcap"]
    for name in (*ours, *theirs):
        (out / name).write_text(name)
    recreate(out)
    assert sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()) == sorted(theirs)


def test_a_folder_that_is_not_there_is_made(tmp_path: Path) -> None:
    recreate(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()


def test_a_disk_that_is_full_is_told_before_anything_flies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def write(_path: Path, _data: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", write)
    with pytest.raises(Refused, match="cannot be written: No space left on device"):
        recreate(tmp_path / "out")


@pytest.mark.parametrize("name", ["file", "file/below", "/proc/none"])
def test_a_folder_that_cannot_be_had_is_refused_with_the_reason(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(Refused, match="cannot be written: "):
        recreate(tmp_path / name)
