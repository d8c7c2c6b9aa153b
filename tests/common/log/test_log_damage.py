"""Damaged logs: whatever happens to a file, what lies before the damage is read, and what is missing is said."""

import resource
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from gloc3.errors import InputError
from gloc3.log.reader import LogReader
from gloc3.log.recover import recover
from gloc3.log.scan import Chunk, Scan
from gloc3.log.writer import MAGIC
from gloc3.messages.envelope import Envelope
from gloc3.messages.standard_topics import TOPICS
from gloc3.messages.topics import TopicTable

from .samples import small_log, tiny_log

pytestmark = pytest.mark.thorough

FINISHED, SENT = small_log()
TINY = tiny_log()
KILLED, _ = small_log(is_closed=False)
TYPES = TopicTable(TOPICS).types


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "log.mcap"


def envelopes(file: Path, data: bytes) -> tuple[list[Envelope[Any]], list[str]]:
    """What is read from some bytes, and what is said to be missing."""
    file.write_bytes(data)
    with LogReader(file, TYPES) as reader:
        return [entry.envelope for entry in reader.entries()], reader.losses()


def whole_chunks(data: bytes, end: int) -> int:
    """Messages in the chunks that lie wholly before an offset."""
    scan = Scan(data)
    return sum(ours(scan, chunk) for chunk in scan.chunks if chunk.end <= end)


def ours(scan: Scan, chunk: Chunk) -> int:
    """Messages of a chunk, without those that only Foxglove reads."""
    return sum("type" in scan.channels[message.channel].metadata for message in scan.messages(chunk))


def test_a_killed_process_leaves_a_log_that_is_read_to_its_last_flush(file: Path) -> None:
    found, losses = envelopes(file, KILLED)
    assert found == SENT
    (loss,) = losses
    assert "not finished" in loss
    assert "ends at 1.200 s" in loss


def test_cut_off_at_any_byte_everything_before_is_read() -> None:
    ends = [(chunk.end, len(Scan(TINY).messages(chunk))) for chunk in Scan(TINY).chunks]
    assert len(ends) == 3
    for size in range(len(TINY)):
        scan = Scan(TINY[:size])
        assert not scan.is_finished
        assert scan.is_log
        assert sum(1 for _ in scan.raw_messages()) == sum(count for end, count in ends if end <= size)


def test_cut_off_in_many_places_the_reader_says_what_is_lost(file: Path) -> None:
    file.write_bytes(FINISHED)
    for size in range(len(FINISHED) - 1, 0, -41):
        with file.open("r+b") as stream:
            stream.truncate(size)
        with LogReader(file, TYPES) as reader:
            assert len([entry.envelope for entry in reader.entries()]) == whole_chunks(FINISHED, size)
            assert reader.losses()


def test_one_wrong_byte_costs_one_chunk_at_most_and_is_noticed() -> None:
    chunks = Scan(TINY).chunks
    counts = [len(Scan(TINY).messages(chunk)) for chunk in chunks]
    for at in range(len(MAGIC), chunks[-1].end, 2):
        scan = Scan(TINY[:at] + bytes([TINY[at] ^ 0x20]) + TINY[at + 1 :])
        assert sum(1 for _ in scan.raw_messages()) >= sum(counts) - max(counts)
        assert scan.gaps or scan.is_altered


class Sliced(bytes):
    """A file's bytes, with the longest part that was taken of them at once."""

    longest = 0

    def __getitem__(self, part: Any) -> Any:
        found = super().__getitem__(part)
        if isinstance(part, slice):
            self.longest = max(self.longest, len(found))
        return found


def test_the_checksum_over_a_whole_file_is_taken_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gloc3.log.scan.STEP_BYTES", 1 << 8)
    data, file = FINISHED, Sliced(FINISHED)
    assert not Scan(file).is_altered
    assert 4 * file.longest < len(data)
    at = len(data) // 2
    assert Scan(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]).is_altered


def test_a_damaged_chunk_is_named_with_the_time_that_is_lost(file: Path) -> None:
    chunk = Scan(FINISHED).chunks[2]
    data = bytearray(FINISHED)
    data[chunk.data_offset + 20] ^= 0xFF
    found, losses = envelopes(file, bytes(data))
    assert [envelope for envelope in SENT if envelope in found] == found
    assert len(SENT) - len(found) == ours(Scan(FINISHED), chunk)
    lost = f"{chunk.end - chunk.offset} bytes are lost, after 0.600 s and before 0.900 s"
    assert losses == [f"a damaged chunk at byte {chunk.offset}: {lost}"]


def test_after_a_part_that_makes_no_sense_reading_goes_on(file: Path) -> None:
    first, second = Scan(FINISHED).chunks[1:3]
    data = bytearray(FINISHED)
    data[first.offset : second.offset] = b"\x7f" * (second.offset - first.offset)
    found, losses = envelopes(file, bytes(data))
    assert len(SENT) - len(found) == ours(Scan(FINISHED), first)
    assert "a damaged record" in losses[0]


def test_a_log_without_its_channels_takes_them_from_the_index(file: Path) -> None:
    chunk = Scan(FINISHED).chunks[1]
    data = bytearray(FINISHED)
    data[len(MAGIC) : chunk.offset] = b"\x7f" * (chunk.offset - len(MAGIC))
    found, losses = envelopes(file, bytes(data))
    assert len(found) == whole_chunks(FINISHED, len(FINISHED)) - ours(Scan(FINISHED), Scan(FINISHED).chunks[0])
    assert found == SENT[-len(found) :]
    assert "the log's description record is lost: times count from 1970" in losses


def test_unknown_and_changed_types_are_read_as_dictionaries(file: Path) -> None:
    file.write_bytes(FINISHED)
    with LogReader(file, TopicTable().types) as reader:
        poses = [entry.envelope.payload for entry in reader.entries("pose")]
    assert poses[1]["position_ned_m"] == [0.1, 0.2, -1.5]
    assert not {"pose", "timestamp", "_t_s"} & set(poses[1])


@pytest.mark.parametrize("data", [b"MCAP", b"not a log at all", MAGIC[:-1] + b"x" * 100])
def test_what_is_no_log_is_said_to_be_none(file: Path, data: bytes) -> None:
    file.write_bytes(data)
    with pytest.raises(InputError, match="is not a log"):
        LogReader(file)


def test_a_file_that_is_not_there_is_named(file: Path) -> None:
    with pytest.raises(InputError, match=r"log.mcap: cannot be read: No such file"):
        LogReader(file)


@settings(max_examples=60)
@given(st.binary(max_size=400), st.integers(0, len(FINISHED)), st.integers(0, 300))
def test_no_bytes_whatever_break_the_reader(noise: bytes, at: int, skipped: int) -> None:
    scan = Scan(MAGIC + (FINISHED[len(MAGIC) : at] + noise + FINISHED[at + skipped :]))
    assert len(list(scan.raw_messages())) <= len(list(Scan(FINISHED).raw_messages()))


def test_recovery_makes_a_finished_log_of_what_is_there(file: Path, tmp_path: Path) -> None:
    file.write_bytes(KILLED[: Scan(KILLED).chunks[-1].offset + 7])
    out = tmp_path / "recovered.mcap"
    report = recover(file, out)
    with LogReader(file, TYPES) as damaged, LogReader(out, TYPES) as recovered:
        assert recovered.is_finished
        assert recovered.losses() == []
        assert list(recovered.entries()) == list(damaged.entries())
        assert recovered.run == damaged.run
        assert report.messages == sum(len(messages) for _, messages in damaged.chunks())
        assert recovered.metadata("recovered") == {"lost": "\n".join(report.losses)}


def test_a_recovery_for_which_the_disk_has_no_room_leaves_nothing_that_the_next_one_would_meet(
    file: Path, tmp_path: Path
) -> None:
    file.write_bytes(KILLED)
    out = tmp_path / "recovered.mcap"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
    try:
        with pytest.raises(InputError, match="cannot be written: File too large"):
            recover(file, out)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not out.exists()
    recover(file, out)
    with pytest.raises(InputError, match="File exists"):
        recover(file, out)
    assert out.exists()


@pytest.mark.parametrize("is_cut", [False, True])
def test_a_log_that_another_program_has_written_anew_is_read_and_recovered_with_its_schemas(
    file: Path, tmp_path: Path, is_cut: bool
) -> None:
    with file.open("wb") as stream:
        writer = Writer(stream)  # it describes channels in its chunks
        writer.start()
        schema = writer.register_schema("pkg/Pose", "ros2msg", b"float64 x")
        channel = writer.register_channel("pelican/pose", "json", schema, {"platform": "pelican", "type": "Other#1"})
        for number in range(3):
            writer.add_message(channel, number, b'{"_t_s":%d,"x":1}' % number, number, number)
        writer.finish()  # type: ignore[no-untyped-call]
    data = file.read_bytes()
    if is_cut:
        file.write_bytes(data[: Scan(data).chunks[0].end])
    out = tmp_path / "recovered.mcap"
    recover(file, out)
    with LogReader(file, TYPES) as given, LogReader(out, TYPES) as recovered:
        entries = list(given.entries())
        assert [entry.envelope.payload for entry in entries] == [{"x": 1}] * 3
        assert list(recovered.entries()) == entries
        (kept,) = recovered.scan.schemas.values()
        assert (kept.name, kept.encoding, kept.data) == ("pkg/Pose", "ros2msg", b"float64 x")
