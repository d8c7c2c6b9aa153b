"""Finds the readable records of an MCAP file that may be unfinished, truncated or damaged, and lists the gaps.

The file is walked from record to record. Where that fails (a length that does not fit), the walk continues at the next
chunk. A chunk with a wrong checksum is skipped as a whole. Other programs write channels and schemas into the chunks:
where neither the file nor its summary describes a channel that a chunk's index names, the chunk is opened at once.
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from mmap import mmap
from typing import Any, Final, NamedTuple

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from gloc3.log.writer import MAGIC, MESSAGE_HEAD

RECORD_HEAD: Final = struct.Struct("<BQ")
CHUNK_HEAD: Final = struct.Struct("<QQQII")
"""Start, end, size and checksum before compression, length of the compression's name."""
COMPRESSIONS: Final = ("", "lz4", "zstd")
CHUNK_BYTES_MAX: Final = 1 << 30
FOOTER_BYTES: Final = 9 + 20 + len(MAGIC)

_READERS: Final[dict[int, Any]] = {
    Opcode.HEADER: Header.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.METADATA: Metadata.read,
}
MESSAGE_BYTES_MIN: Final = 22
DATA_END_BYTES: Final = 4
STEP_BYTES: Final = 1 << 20
LIBRARY: Final = "gloc3 "
"""Begin of what a log says of the program that wrote it, if it was this one: such a file has no later records."""
PRIVATE_OPCODES: Final = 0x80
"""First opcode reserved for applications."""


Data = bytes | mmap
"""A file's bytes, or a memory map of it."""


class Chunk(NamedTuple):
    """Position of a chunk in the file."""

    offset: int
    end: int
    start_ns: int
    end_ns: int
    size: int
    """Before compression."""
    crc: int
    compression: str
    data_offset: int


class RawMessage(NamedTuple):
    """A message as it lies in a chunk."""

    channel: int
    sequence: int
    log_ns: int
    publish_ns: int
    data: bytes


class Gap(NamedTuple):
    """A part of the file that cannot be read."""

    offset: int
    end: int
    reason: str


class Scan:
    """Index of a file's contents; messages are read later, chunk by chunk."""

    def __init__(self, data: Data) -> None:
        """Walks the file.

        Args:
            data: its content.
        """
        self._data = data
        self.is_log = data[: len(MAGIC)] == MAGIC[: len(data)]
        """Whether the file begins with the MCAP magic."""
        self.is_finished = len(data) >= FOOTER_BYTES and data[-len(MAGIC) :] == MAGIC and self._has_footer()
        self.is_complete = False
        """Whether the end of the messages was reached; an index may still be missing."""
        self.is_altered = False
        """Whether the checksum over everything is wrong."""
        self.library = ""
        self.profile = ""
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.chunks: list[Chunk] = []
        self.metadata: list[Metadata] = []
        self.attachments: list[Attachment] = []
        self.gaps: list[Gap] = []
        self._indexed: dict[int, set[int]] = {}
        """Offset of a chunk to the channels that the index after it names."""
        if self.is_log:
            self._walk()

    def _has_footer(self) -> bool:
        at = len(self._data) - FOOTER_BYTES
        return bool(RECORD_HEAD.unpack_from(self._data, at) == (Opcode.FOOTER, 20))

    def _walk(self) -> None:
        at, size = len(MAGIC), len(self._data)
        while 0 < at < size:
            end = self._record(at)
            if end < 0:
                found = self._next_chunk(at + 1)
                reason = "a damaged record" if found else "the file ends within a record"
                self.gaps.append(Gap(at, found or size, reason))
                self._drop_index()
                end = found
            at = end
        if not self.is_complete:
            self._drop_index()
        self._summary()
        for chunk in self.chunks:
            named = self._indexed.get(chunk.offset)
            if chunk.data_offset > chunk.offset and (named is None or not named <= self.channels.keys()):
                self.messages(chunk)

    def _drop_index(self) -> None:
        """The index after the last chunk is not whole: it may not name all of the chunk's channels."""
        if self.chunks:
            self._indexed.pop(self.chunks[-1].offset, None)

    def _record(self, at: int) -> int:
        """Takes in the record at an offset; returns where it ends, 0 after the last one, -1 where there is none."""
        data = self._data
        if at + RECORD_HEAD.size > len(data):
            return -1
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        begin = at + RECORD_HEAD.size
        end = begin + length
        if end > len(data):
            return -1
        fits = True
        match opcode:
            case Opcode.CHUNK:
                chunk = self._chunk_at(at)
                fits = chunk is not None
                self.chunks += [chunk] if chunk is not None else []
            case Opcode.MESSAGE if length >= MESSAGE_BYTES_MIN:  # another program's log without chunks
                log_ns = MESSAGE_HEAD.unpack_from(data, at)[4]
                self.chunks.append(Chunk(at, end, log_ns, log_ns, end - at, 0, "", at))
            case Opcode.MESSAGE_INDEX:
                fits = length >= 6 and length == 6 + struct.unpack_from("<I", data, begin + 2)[0]
                if fits and self.chunks:
                    (channel,) = struct.unpack_from("<H", data, begin)
                    self._indexed.setdefault(self.chunks[-1].offset, set()).add(channel)
            case Opcode.DATA_END if length == DATA_END_BYTES:
                self.is_complete = True
                crc = int.from_bytes(data[begin:end], "little")
                self.is_altered = crc != 0 and crc != _checksum(data, at)
                return 0
            case _ if opcode in _READERS:
                record = self._parse(opcode, data[begin:end])
                fits = record is not None
                self._add_record(record)
            case _:
                fits = opcode >= PRIVATE_OPCODES or self._is_of_later_version(opcode, end)
        return int(end) if fits else -1

    def _is_of_later_version(self, opcode: int, end: int) -> bool:
        """Whether a record has an opcode of a later version of the format; this program writes none."""
        if self._is_ours or not opcode > Opcode.DATA_END or end + RECORD_HEAD.size > len(self._data):
            return False
        following, length = RECORD_HEAD.unpack_from(self._data, end)
        return following in (*Opcode,) and end + RECORD_HEAD.size + length <= len(self._data)

    @property
    def _is_ours(self) -> bool:
        return self.library.startswith(LIBRARY)

    def _parse(self, opcode: int, body: bytes) -> Any:
        """The record in some bytes; None where it is damaged."""
        record, size = _record_in(opcode, body)
        is_ours = record.library.startswith(LIBRARY) if isinstance(record, Header) else self._is_ours
        return None if is_ours and size != len(body) else record

    def _add_record(self, record: Any) -> None:
        match record:
            case Header():
                self.library, self.profile = record.library, record.profile
            case Schema():
                self.schemas.setdefault(record.id, record)
            case Channel():
                self.channels.setdefault(record.id, record)
            case Metadata():
                self.metadata.append(record)
            case Attachment():
                self.attachments.append(record)

    def _summary(self) -> None:
        """Reads the channels and schemas at the end of a finished file: of damaged parts, and of chunks."""
        if not self.is_finished:
            return
        footer = len(self._data) - FOOTER_BYTES
        at = int(struct.unpack_from("<Q", self._data, footer + RECORD_HEAD.size)[0])
        while 0 < at <= footer - RECORD_HEAD.size:
            opcode, length = RECORD_HEAD.unpack_from(self._data, at)
            begin, at = at + RECORD_HEAD.size, at + RECORD_HEAD.size + length
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL) and at <= footer:
                self._add_record(self._parse(opcode, self._data[begin:at]))

    def _chunk_at(self, at: int) -> Chunk | None:
        """The chunk at an offset, if its parts fit together."""
        data = self._data
        begin = at + RECORD_HEAD.size
        try:
            opcode, length = RECORD_HEAD.unpack_from(data, at)
            start_ns, end_ns, size, crc, name_length = CHUNK_HEAD.unpack_from(data, begin)
            name_at = begin + CHUNK_HEAD.size
            compression = bytes(data[name_at : name_at + name_length]).decode("ascii", "replace")
            (packed,) = struct.unpack_from("<Q", data, name_at + name_length)
        except struct.error:
            return None
        data_offset, end = name_at + name_length + 8, begin + length
        fits = opcode == Opcode.CHUNK and data_offset + packed == end <= len(data) and start_ns <= end_ns
        if not fits or compression not in COMPRESSIONS or size > CHUNK_BYTES_MAX:
            return None
        return Chunk(at, end, start_ns, end_ns, size, crc, compression, data_offset)

    def _next_chunk(self, at: int) -> int:
        """Position of the next chunk; 0 if there is none."""
        opcode = bytes([Opcode.CHUNK])
        at = self._data.find(opcode, at)
        while at >= 0:
            if self._chunk_at(at) is not None:
                return int(at)
            at = self._data.find(opcode, at + 1)
        return 0

    def messages(self, chunk: Chunk) -> list[RawMessage]:
        """The messages of a chunk, in the order of recording; none, and a gap, where it is damaged."""
        packed = bytes(self._data[chunk.data_offset : chunk.end])
        data = _unpack(packed, chunk)
        if data is None:
            self._add_gap(Gap(chunk.offset, chunk.end, "a damaged chunk"))
            return []
        found = []
        at, size = 0, len(data)
        while at + MESSAGE_HEAD.size <= size:
            opcode, length, channel, sequence, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(data, at)
            end = at + RECORD_HEAD.size + length
            if opcode == Opcode.MESSAGE:
                found.append(RawMessage(channel, sequence, log_ns, publish_ns, data[at + MESSAGE_HEAD.size : end]))
            elif opcode in _READERS:
                self._add_record(self._parse(opcode, data[at + RECORD_HEAD.size : end]))
            at = end
        return found

    def _add_gap(self, gap: Gap) -> None:
        if gap not in self.gaps:
            self.gaps.append(gap)
            self.gaps.sort()

    def raw_messages(self) -> Iterator[RawMessage]:
        """All messages, in the order of recording."""
        for chunk in self.chunks:
            yield from self.messages(chunk)


def _checksum(data: Data, end: int) -> int:
    """The CRC-32 of a file's first bytes, without a copy of the whole file."""
    crc = 0
    for at in range(0, end, STEP_BYTES):
        crc = zlib.crc32(data[at : min(at + STEP_BYTES, end)], crc)
    return crc


def _record_in(opcode: int, body: bytes) -> tuple[Any, int]:
    """The record in some bytes and its size, behind which a later version of the format may have more fields.

    None where it is damaged, that is: where the same record would be other bytes, or its checksum is wrong.
    """
    try:
        record = _READERS[opcode](ReadDataStream(BytesIO(body)))
    except (EndOfFile, struct.error, UnicodeDecodeError, OverflowError):
        return None, 0
    builder = RecordBuilder()
    record.write(builder)
    same = bytes(builder.end())[RECORD_HEAD.size :]  # type: ignore[no-untyped-call]
    size = len(same)
    if opcode == Opcode.ATTACHMENT and not any(body[size - 4 : size]):
        same = same[:-4]  # its checksum has not been computed
    return (record, size) if body.startswith(same) else (None, 0)


def _unpack(packed: bytes, chunk: Chunk) -> bytes | None:
    """The content of a chunk; None where it is damaged."""
    try:
        if chunk.compression == "zstd":
            from zstandard import ZstdDecompressor, ZstdError

            try:
                data = ZstdDecompressor().decompress(packed, max_output_size=chunk.size)
            except ZstdError:
                return None
        elif chunk.compression == "lz4":
            from lz4.frame import decompress  # type: ignore[import-untyped]

            data = bytes(decompress(packed))
        else:
            data = packed
    except (RuntimeError, MemoryError):
        return None
    is_whole = len(data) == chunk.size and (chunk.crc == 0 or zlib.crc32(data) == chunk.crc)
    return data if is_whole else None
