"""Writes MCAP files: messages are appended by fast code of our own, all other records by the mcap library.

The library's own writer takes 5 microseconds a message, this one less than 1; the log is written in every cycle of
everything. Format: https://mcap.dev/spec.
"""

import struct
import zlib
from collections.abc import Callable, Mapping
from typing import BinaryIO, Final, Literal

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.records import Channel as ChannelRecord

from gloc3 import __version__
from gloc3.log.disk_file import DiskFile

MAGIC: Final = b"\x89MCAP0\r\n"
MESSAGE_HEAD: Final = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence, log time, publish time."""
INDEX_HEAD: Final = struct.Struct("<BQHI")
"""Opcode, length, channel, bytes of the pairs of time and offset that follow."""
CHUNK_BYTES: Final = 1 << 20
"""A chunk that has grown so large is written without waiting for the flush."""

Compression = Literal["", "lz4", "zstd"]


class LogChannel:
    """A channel of the file, and the messages appended to it."""

    __slots__ = ("bytes", "id", "index", "messages", "topic")

    def __init__(self, identifier: int, topic: str) -> None:
        self.id: Final = identifier
        self.topic: Final = topic
        self.messages = 0
        self.bytes = 0
        """Of the messages' data, before compression."""
        self.index: list[int] = []
        """Log time and offset of each message in the current chunk, alternating."""


class McapWriter:
    """An MCAP file being written; flushed data can be read even if the file is never finished."""

    def __init__(self, stream: BinaryIO | DiskFile, compression: Compression = "zstd", profile: str = "") -> None:
        self._stream = stream
        self._compression = compression
        self._compress = _compressor(compression)
        self._offset = 0
        self._crc = 0
        self._chunk = bytearray()
        self._schemas: dict[tuple[str, bytes, str], Schema] = {}
        self._channels: list[tuple[ChannelRecord, LogChannel]] = []
        self._indexes: dict[Opcode, list[McapRecord]] = {
            Opcode.CHUNK_INDEX: [],
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: [],
        }
        self._start_ns, self._end_ns = 0, 0
        self._write(MAGIC)
        self._write_record(Header(profile=profile, library=f"gloc3 {__version__}"))

    def add_channel(
        self,
        topic: str,
        encoding: str,
        metadata: Mapping[str, str],
        schema: tuple[str, bytes] | None = None,
        schema_encoding: str = "jsonschema",
    ) -> LogChannel:
        """Declares a channel; `schema` is the name and text of a schema."""
        identifier = 0
        if schema is not None:
            key = (*schema, schema_encoding)
            record = self._schemas.get(key)
            if record is None:
                name, data = schema
                record = Schema(id=len(self._schemas) + 1, name=name, encoding=schema_encoding, data=data)
                self._schemas[key] = record
                self._write_record(record)
            identifier = record.id
        channel = LogChannel(len(self._channels) + 1, topic)
        channel_record = ChannelRecord(
            id=channel.id, topic=topic, message_encoding=encoding, metadata=dict(metadata), schema_id=identifier
        )
        self._channels.append((channel_record, channel))
        self._write_record(channel_record)
        return channel

    def append(self, channel: LogChannel, sequence: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Appends a message; the times are nanoseconds since 1970."""
        chunk = self._chunk
        offset, size = len(chunk), len(data)
        chunk += MESSAGE_HEAD.pack(Opcode.MESSAGE, 22 + size, channel.id, sequence, log_ns, publish_ns)
        chunk += data
        channel.index += (log_ns, offset)
        channel.bytes += size
        if offset > CHUNK_BYTES:
            self._write_chunk()

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Writes a metadata record at once."""
        offset = self._offset
        length = self._write_record(Metadata(name=name, metadata=dict(values)))
        self._indexes[Opcode.METADATA_INDEX].append(MetadataIndex(offset=offset, length=length, name=name))

    def add_attachment(self, name: str, media_type: str, data: bytes, log_ns: int) -> None:
        """Writes an attachment at once; its time of creation counts as that of writing."""
        offset = self._offset
        record = Attachment(create_time=log_ns, log_time=log_ns, name=name, media_type=media_type, data=data)
        index = AttachmentIndex(
            offset=offset,
            length=self._write_record(record),
            create_time=log_ns,
            log_time=log_ns,
            data_size=len(data),
            name=name,
            media_type=media_type,
        )
        self._indexes[Opcode.ATTACHMENT_INDEX].append(index)

    def flush(self) -> None:
        """Flushes everything: once the operating system has it, a killed process does not lose it."""
        if self._chunk:
            self._write_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Writes the index and the end of the file; the stream stays open."""
        if self._chunk:
            self._write_chunk()
        self._write_record(DataEnd(data_section_crc=self._crc))
        start = self._offset
        groups: dict[Opcode, list[McapRecord]] = {
            Opcode.SCHEMA: list(self._schemas.values()),
            Opcode.CHANNEL: [record for record, _ in self._channels],
            Opcode.STATISTICS: [self._statistics()],
            **self._indexes,
        }
        summary = RecordBuilder()
        offsets = []
        for opcode, records in groups.items():
            begin = summary.count
            for record in records:
                record.write(summary)
            if records:
                offsets.append(
                    SummaryOffset(group_opcode=opcode, group_start=start + begin, group_length=summary.count - begin)
                )
        offsets_start = start + summary.count
        for entry in offsets:
            entry.write(summary)
        data: bytes = summary.end()  # type: ignore[no-untyped-call]
        footer_head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_start)
        self._write(data)
        self._write_record(Footer(start, offsets_start, zlib.crc32(footer_head, zlib.crc32(data))))
        self._write(MAGIC)
        self._stream.flush()

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._indexes[Opcode.ATTACHMENT_INDEX]),
            channel_count=len(self._channels),
            channel_message_counts={channel.id: channel.messages for _, channel in self._channels if channel.messages},
            chunk_count=len(self._indexes[Opcode.CHUNK_INDEX]),
            message_count=sum(channel.messages for _, channel in self._channels),
            message_start_time=self._start_ns,
            message_end_time=self._end_ns,
            metadata_count=len(self._indexes[Opcode.METADATA_INDEX]),
            schema_count=len(self._schemas),
        )

    def _write_chunk(self) -> None:
        """Writes the messages gathered so far as a chunk, with the index of each channel's messages."""
        data = bytes(self._chunk)
        self._chunk.clear()
        used = [channel for _, channel in self._channels if channel.index]
        start_ns = min(min(channel.index[::2]) for channel in used)
        end_ns = max(max(channel.index[::2]) for channel in used)
        self._start_ns = min(self._start_ns or start_ns, start_ns)
        self._end_ns = max(self._end_ns, end_ns)
        packed = self._compress(data)
        chunk_start = self._offset
        chunk_length = self._write_record(
            Chunk(
                compression=self._compression,
                data=packed,
                message_start_time=start_ns,
                message_end_time=end_ns,
                uncompressed_crc=zlib.crc32(data),
                uncompressed_size=len(data),
            )
        )
        index_start = index_end = self._offset
        offsets: dict[int, int] = {}
        parts: list[bytes] = []
        for channel in used:
            pairs = channel.index
            channel.index = []
            channel.messages += len(pairs) // 2
            offsets[channel.id] = index_end
            size = 8 * len(pairs)
            part = INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + size, channel.id, size) + struct.pack(
                f"<{len(pairs)}Q", *pairs
            )
            parts.append(part)
            index_end += len(part)
        self._write(b"".join(parts))
        self._indexes[Opcode.CHUNK_INDEX].append(
            ChunkIndex(
                chunk_length=chunk_length,
                chunk_start_offset=chunk_start,
                compression=self._compression,
                compressed_size=len(packed),
                message_start_time=start_ns,
                message_end_time=end_ns,
                message_index_length=index_end - index_start,
                message_index_offsets=offsets,
                uncompressed_size=len(data),
            )
        )

    def _write_record(self, record: McapRecord) -> int:
        """Writes a record; returns its length in bytes."""
        builder = RecordBuilder()
        record.write(builder)
        data: bytes = builder.end()  # type: ignore[no-untyped-call]
        self._write(data)
        return len(data)

    def _write(self, data: bytes) -> None:
        self._stream.write(data)
        self._offset += len(data)
        self._crc = zlib.crc32(data, self._crc)


def _compressor(compression: Compression) -> Callable[[bytes], bytes]:
    if compression == "zstd":
        from zstandard import ZstdCompressor

        return ZstdCompressor(level=1).compress
    if compression == "lz4":
        from lz4.frame import compress  # type: ignore[import-untyped]

        return lambda data: bytes(compress(data))
    return bytes
