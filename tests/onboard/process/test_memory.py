"""The memory of components: it outlives the process, not the computer's start."""

from pathlib import Path

from gloc3.store import MemoryRecords, RecordFile
from gloc3_onboard.process.memory import RecordMemory


def test_what_is_kept_last_is_there_for_the_next_process(tmp_path: Path) -> None:
    first = RecordMemory(RecordFile(tmp_path / "memory.state"), "monday")
    assert first.load() is None
    first.keep(b"one")
    first.keep(b"two")
    assert RecordMemory(RecordFile(tmp_path / "memory.state"), "monday").load() == b"two"
    assert RecordMemory(RecordFile(tmp_path / "memory.state"), "tuesday").load() is None, "its clock began anew"


def test_what_cannot_be_read_is_nothing() -> None:
    records = MemoryRecords()
    records.rewrite([b"\xff\xff"])
    assert RecordMemory(records, "").load() is None
