"""Any valid MCAP is read, whoever wrote it; each subcommand says what such a file lacks."""

import io
import json
import struct
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from mcap.data_stream import RecordBuilder
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, McapRecord, Message, Schema
from mcap.writer import Writer

from gloc3.errors import Refused
from gloc3.log.cli import app
from gloc3.log.fields import read_series
from gloc3.log.info import summarize
from gloc3.log.reader import LogReader
from gloc3.log.scan import RECORD_HEAD, Scan
from gloc3.log.writer import MAGIC
from gloc3.messages.topics import TopicTable

from .foreign_logs import COUNT, FOREIGN, NO_SUMMARY, START_NS, STEP_NS, by_another, by_library
from .samples import small_log


@pytest.fixture(params=FOREIGN)
def file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / "other.mcap"
    FOREIGN[request.param](path)
    return path


def run(*arguments: object) -> Any:
    return app([str(argument) for argument in arguments], exit_on_error=True, result_action="return_value")


def by_the_library(file: Path) -> list[tuple[str, int, int, bytes]]:
    """All messages, as the mcap library reads them, in the order of the file."""
    with file.open("rb") as stream:
        found = NonSeekingReader(stream, validate_crcs=True).iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time, message.sequence, message.data) for _, channel, message in found]


def by_us(file: Path) -> list[tuple[str, int, int, bytes]]:
    with LogReader(file) as reader:
        found = [
            (reader.channel(message.channel).topic, message.log_ns, message.sequence, message.data)
            for _, messages in reader.chunks()
            for message in messages
        ]
        assert reader.losses() == []
        return found


def test_what_is_read_of_a_foreign_log_is_what_the_mcap_library_reads(file: Path) -> None:
    found = by_us(file)
    assert found == by_the_library(file)
    assert len(found) >= COUNT


def test_info_counts_the_topics_of_a_foreign_log(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", file, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    counts = Counter(topic for topic, *_ in by_the_library(file))
    assert {topic["topic"]: topic["messages"] for topic in found["topics"]} == counts
    assert found["duration_s"] == pytest.approx((COUNT - 1) * STEP_NS / 1e9)
    assert found["start_s"] == 0.0
    assert found["is_foreign"]
    assert run("info", file) == 0
    assert "not by GLOC3: times count from its first message" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "needed"),
    [
        (("commands",), "requests of stations"),
        (("why", "3"), "events"),
        (("plot",), "position"),
        (("plot", "components"), "states of components"),
        (("replay", "pose"), "recorded inputs"),
        (("report",), "pictures with poses"),
        (("fork", "--at", "3", "--fault", "battery"), "simulated flight"),
    ],
)
def test_each_subcommand_says_what_a_foreign_log_lacks(arguments: tuple[str, ...], needed: str, tmp_path: Path) -> None:
    file = tmp_path / "other.mcap"
    FOREIGN["without a summary"](file)
    name, *rest = arguments
    given = ["--out", str(tmp_path / "out")] if name == "fork" else []
    with pytest.raises(Refused, match=f"written by a survey tool 2.0, not by GLOC3: it has no {needed}"):
        run(name, file, *rest, *given)


def test_a_json_topic_of_a_foreign_log_is_a_series_and_other_encodings_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "other.mcap"
    FOREIGN["without a summary"](file)
    with LogReader(file) as reader:
        (series,) = read_series(reader, "thing", ["inner.list[1]"])
        with pytest.raises(Refused, match="only topics in JSON can be drawn"):
            read_series(reader, "raw", [])
    assert series.values == [float(index) for index in range(COUNT)]
    assert series.t_s[:2] == [0.0, STEP_NS / 1e9]


def test_recovering_a_foreign_log_keeps_its_messages_and_its_profile(file: Path, tmp_path: Path) -> None:
    target = tmp_path / "recovered.mcap"
    assert run("recover", file, target) == 0
    assert by_the_library(target) == by_the_library(file)
    with file.open("rb") as before, target.open("rb") as after:
        assert make_reader(after).get_header().profile == make_reader(before).get_header().profile


@pytest.mark.parametrize("how", [{}, NO_SUMMARY, {"use_chunking": False}])
def test_our_log_copied_by_another_program_is_still_ours(how: dict[str, Any], tmp_path: Path) -> None:
    data, sent = small_log(60)
    file = tmp_path / "log.mcap"
    file.write_bytes(by_another(data, **how))
    with LogReader(file) as reader:
        assert not reader.is_foreign
        assert [entry.envelope for entry in reader.entries()] == sent
        assert reader.losses() == []


def test_a_log_of_ours_without_a_command_interface_is_not_one_without_commands(tmp_path: Path) -> None:
    file = tmp_path / "log.mcap"
    file.write_bytes(small_log()[0])
    with pytest.raises(Refused, match="has no requests of stations: no topic ci/\\* is recorded in it"):
        run("commands", file)


def test_a_topic_that_begins_in_the_last_chunk_is_read_wherever_its_index_is_cut(tmp_path: Path) -> None:
    whole = io.BytesIO()
    writer = Writer(whole, chunk_size=400)
    writer.start("", "a survey tool 2.0")
    schema = writer.register_schema("Thing", "jsonschema", b"{}")
    early = [writer.register_channel(f"/{name}", "json", schema) for name in "ab"]
    for index in range(40):
        if index == 36:
            early.append(writer.register_channel("/late", "json", schema))
        for channel in early:
            writer.add_message(channel, START_NS + index * STEP_NS, b'{"x_m":1}', START_NS + index * STEP_NS)
    writer.finish()  # type: ignore[no-untyped-call]
    data = whole.getvalue()
    scan = Scan(data)
    chunk = next(chunk for chunk in scan.chunks if any(message.channel == 3 for message in scan.messages(chunk)))
    after = next((later.offset for later in scan.chunks if later.offset > chunk.offset), data.rindex(b"\x0f"))
    file = tmp_path / "cut.mcap"
    for end in range(chunk.end, after):
        file.write_bytes(data[:end])
        with LogReader(file) as reader:
            assert [topic.topic for topic in summarize(reader, TopicTable()).topics] == ["/a", "/b", "/late"]
            assert read_series(reader, "late", ["x_m"])[0].values[:1] == [1.0]


@pytest.mark.parametrize("chunks", [{}, {"use_chunking": False}])
def test_an_attachment_whose_checksum_is_not_computed_is_read(chunks: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / "other.mcap"
    by_library(file, **chunks)
    data = bytearray(file.read_bytes())
    at = data.index(b"calm") + len(b"calm")
    assert int.from_bytes(data[at : at + 4], "little") != 0
    data[at : at + 4] = bytes(4)
    end = data.index(b"\x0f\x04\0\0\0\0\0\0\0", at) + RECORD_HEAD.size
    data[end : end + 4] = bytes(4)
    file.write_bytes(data)
    assert by_us(file) == by_the_library(file)
    with LogReader(file) as reader:
        assert reader.attachments == {"notes.txt": b"calm"}


def other(*records: bytes) -> bytes:
    """A log of another program without an index."""
    return b"".join((MAGIC, record(Header("", "other")), *records, record(DataEnd(0)), record(Footer(0, 0, 0)), MAGIC))


def record(of: McapRecord) -> bytes:
    builder = RecordBuilder()
    of.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def longer(of: McapRecord, more: bytes = b"more") -> bytes:
    """A record with a field of a later version of the format."""
    data = record(of)
    return data[:1] + struct.pack("<Q", len(data) - RECORD_HEAD.size + len(more)) + data[RECORD_HEAD.size :] + more


THING = Schema(1, b"{}", "jsonschema", "Thing")
CHANNEL = Channel(1, "/a", "json", {"who": "someone"}, 1)
MESSAGES = [
    record(Message(channel_id=1, log_time=START_NS + index, publish_time=START_NS + index, data=b"{}", sequence=index))
    for index in range(9)
]


@pytest.mark.parametrize(
    "data",
    [
        other(longer(THING), longer(CHANNEL), *MESSAGES),
        other(record(THING), record(CHANNEL), *MESSAGES[:4], b"\x20" + struct.pack("<Q", 4) + b"abcd", *MESSAGES[4:]),
    ],
    ids=["fields appended", "later opcode"],
)
def test_what_a_later_version_of_the_format_adds_is_skipped(data: bytes, tmp_path: Path) -> None:
    file = tmp_path / "other.mcap"
    file.write_bytes(data)
    assert by_us(file) == by_the_library(file)
    assert len(by_us(file)) == len(MESSAGES)


def test_a_first_chunk_without_messages_does_not_move_the_first_message(tmp_path: Path) -> None:
    chunks = [
        Chunk(
            compression="",
            data=data,
            message_start_time=begin_ns,
            message_end_time=end_ns,
            uncompressed_crc=0,
            uncompressed_size=len(data),
        )
        for data, begin_ns, end_ns in (
            (record(THING) + record(CHANNEL), 0, 0),
            (b"".join(MESSAGES), START_NS, START_NS + len(MESSAGES) - 1),
        )
    ]
    file = tmp_path / "other.mcap"
    file.write_bytes(other(*map(record, chunks)))
    with LogReader(file) as reader:
        assert reader.utc_offset_ns == START_NS
    assert len(by_us(file)) == len(MESSAGES)
