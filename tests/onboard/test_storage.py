"""Files that survive: records torn at any byte, disks that are full, and pictures that are never overwritten."""

import json
import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.vehicle import Image
from gloc3_onboard.drivers.image_recorder import Picture
from gloc3_onboard.storage import MemoryRecords, NoPictures, PictureFolder, RecordFile

RECORDS = [b"first", b"", b"third, which is a little longer", bytes(range(0, 256, 16))]


@pytest.fixture(autouse=True)
def no_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


def test_a_file_torn_at_any_byte_gives_the_records_before_and_takes_new_ones(tmp_path: Path) -> None:
    path = tmp_path / "journal.bin"
    file = RecordFile(path)
    ends = [0]
    for record in RECORDS:
        file.append(record)
        ends.append(path.stat().st_size)
    data = path.read_bytes()
    for cut in range(len(data) + 1):
        path.write_bytes(data[:cut])
        whole = sum(end <= cut for end in ends) - 1
        assert RecordFile(path).load() == RECORDS[:whole]
        assert path.stat().st_size == ends[whole], "the torn end is cut off"
    path.write_bytes(data[:-1])
    file.load()
    file.append(b"next")
    assert file.load() == [*RECORDS[:3], b"next"]


@settings(max_examples=50)
@given(st.integers(0, 400), st.integers(1, 255))
def test_a_damaged_byte_never_gives_another_record(
    tmp_path_factory: pytest.TempPathFactory, at: int, flip: int
) -> None:
    path = tmp_path_factory.mktemp("records") / "journal.bin"
    RecordFile(path).rewrite(RECORDS)
    data = bytearray(path.read_bytes())
    data[at % len(data)] ^= flip
    path.write_bytes(bytes(data))
    found = RecordFile(path).load()
    assert found == RECORDS[: len(found)]
    assert len(found) < len(RECORDS)


def test_a_file_that_is_not_there_has_no_records(tmp_path: Path) -> None:
    assert RecordFile(tmp_path / "new" / "journal.bin").load() == []


def test_rewriting_replaces_everything_and_keeps_to_its_own_file(tmp_path: Path) -> None:
    journal, progress = RecordFile(tmp_path / "kept.journal"), RecordFile(tmp_path / "kept.progress")
    journal.append(b"old")
    journal.rewrite([b"a", b"b"])
    progress.rewrite([b"c"])
    assert (journal.load(), progress.load()) == ([b"a", b"b"], [b"c"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept.journal", "kept.progress"]


def test_a_record_that_does_not_fit_is_told_and_leaves_no_torn_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "journal.bin"
    file = RecordFile(path)
    file.append(b"first")

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space left"):
            file.append(b"second")
    file.append(b"third")
    assert file.load() == [b"first", b"third"]


def test_a_torn_end_is_cut_off_though_there_is_no_room_for_another_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "journal.bin"
    RecordFile(path).append(b"first")
    with path.open("ab") as file:
        file.write(b"\x20\x00")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", full)
        assert RecordFile(path).load() == [b"first"]
    RecordFile(path).append(b"second")
    assert RecordFile(path).load() == [b"first", b"second"]


def test_records_in_memory_are_those_of_the_process_before() -> None:
    records = MemoryRecords()
    records.append(b"a")
    assert records.load() == [b"a"]
    records.rewrite([b"b"])
    assert records.load() == [b"b"]


def picture(number: int, camera: str = "ground") -> Picture:
    image = Image(camera=camera, width=4, height=2, data=bytes(range(8)))
    return Picture(f"{camera}-{number:05d}.png", 1.5, image, (1.0, 2.0, -3.0), (1.0, 0.0, 0.0, 0.0))


def test_pictures_are_real_files_with_their_poses_beside_them(tmp_path: Path) -> None:
    import cv2

    folder = PictureFolder(tmp_path / "images")
    folder.write(picture(1))
    folder.write(picture(2))
    pixels = cv2.imread(str(tmp_path / "images" / "ground-00001.png"), cv2.IMREAD_GRAYSCALE)
    assert pixels is not None
    assert pixels.tobytes() == bytes(range(8))
    tags = [json.loads(line) for line in (tmp_path / "images" / "poses.jsonl").read_text().splitlines()]
    assert [tag["file"] for tag in tags] == ["ground-00001.png", "ground-00002.png"]
    assert tags[0]["position_ned_m"] == [1.0, 2.0, -3.0]
    assert not list((tmp_path / "images").glob("*.part"))


def test_the_numbers_that_are_taken_are_known(tmp_path: Path) -> None:
    folder = PictureFolder(tmp_path)
    assert folder.highest("ground") == 0
    folder.write(picture(7))
    folder.write(picture(9, "front"))
    (tmp_path / "ground-odd.png").write_bytes(b"")
    assert (folder.highest("ground"), folder.highest("front")) == (7, 9)
    nothing = NoPictures()
    nothing.write(picture(1))
    assert (nothing.written, nothing.highest("ground")) == (1, 0)
