"""Reads a log back: envelopes as recorded, and a list of missing data."""

import re
from collections.abc import Iterator
from mmap import ACCESS_READ, mmap
from pathlib import Path
from types import TracebackType
from typing import Any, Final, NamedTuple, Self

import msgspec
from mcap.records import Channel

from gloc3.errors import Finding, InputError, Refused
from gloc3.log.foxglove.schemas import VIEWS
from gloc3.log.payloads import PayloadDecoder
from gloc3.log.record import RUN
from gloc3.log.scan import Chunk, Data, RawMessage, Scan
from gloc3.messages.envelope import Envelope, Message, Source
from gloc3.messages.topics import TopicTable, matches
from gloc3.messages.wire import TypeRegistry, WireError

_NUMBERED: Final = re.compile(r"log(-\d+)?")
"""The logs of an onboard process: `log`, `log-2`, `log-3`..."""
_VIEW_FIELDS: Final = {view.schema: tuple(view.properties) for _, view in VIEWS}


class LoggedMessage(NamedTuple):
    """A message of the log."""

    now_s: float
    """When it was recorded, in seconds since boot of the clock host, to the nanosecond."""
    envelope: Envelope[Any]
    """Its payload is a dictionary where the type is not known here or its version differs."""


def _is_ours(channel: Channel) -> bool:
    """Whether a channel's messages are envelopes."""
    return channel.message_encoding == "json" and "type" in channel.metadata


def below(topic: str) -> str:
    """A topic without the platform's name, or in a foreign log without its first slash."""
    return topic.partition("/")[2] or topic


class MavlinkFrame(NamedTuple):
    """A raw frame of a MAVLink link."""

    now_s: float
    link: str
    direction: str
    data: bytes


class ChannelInfo(NamedTuple):
    """One topic, with its first publisher."""

    topic: str
    encoding: str
    source: Source
    type: str
    frame: str


def find_log(path: Path, topic: str = "") -> Path:
    """Resolves a command's log argument: the file itself, or the last log in the folder of a run.

    Args:
        path: the argument.
        topic: the newest of several hosts' logs that has this topic is meant.

    Raises:
        Refused: there is no log in the folder.
    """
    if not path.is_dir():
        return path
    logs = [log for log in path.glob("log*.mcap") if _NUMBERED.fullmatch(log.stem)]
    if logs:
        return max(logs, key=lambda log: int(log.stem[len("log-") :] or 1))
    others = sorted(path.glob("*.mcap"))
    if len(others) == 1:
        return others[0]
    for log in sorted(others, key=lambda each: each.stat().st_mtime_ns, reverse=True) if topic else ():
        with LogReader(log) as reader:
            if any(matches(f"*/{topic}", one) for one in reader.topics):
                return log
    names = ", ".join(log.name for log in others)
    raise Refused(
        f"{path}: there is {f'more than one log: name one of {names}' if others else 'no log in this folder'}"
    )


class LogReader:
    """A log file, open for reading; finished, unfinished or damaged."""

    def __init__(self, path: Path, types: TypeRegistry | None = None) -> None:
        """Opens a log.

        Args:
            path: the file.
            types: the message types to restore; by default those of every installed package.

        Raises:
            InputError: it cannot be read, or is no log.
        """
        self.path = path
        self._types = types if types is not None else TopicTable.installed().types
        self._decoders: dict[int, PayloadDecoder] = {}
        self._unreadable = 0
        self._orphans = 0
        try:
            with path.open("rb") as file:
                self.size = path.stat().st_size
                self._data: Data = mmap(file.fileno(), 0, access=ACCESS_READ) if self.size else b""
        except OSError as error:
            raise InputError([Finding(file=str(path), message=f"cannot be read: {error.strerror}")]) from error
        self._scan = Scan(self._data)
        if not self._scan.is_log:
            self.close()
            raise InputError([Finding(file=str(path), message="is not a log", hint="logs are MCAP files")])
        self.is_finished: Final = self._scan.is_finished
        self.run: Final = self.metadata(RUN) or {}
        """What the log says of itself."""
        channels = self._scan.channels.values()
        self.is_foreign: Final = not self.run and not any(_is_ours(channel) for channel in channels)
        """Whether another program wrote it: its messages are no envelopes of GLOC3."""
        begins_ns = [chunk.start_ns for chunk in self._scan.chunks if chunk.end_ns]  # 0 in a chunk without messages
        first_ns = min(begins_ns, default=0) if self.is_foreign else 0
        offset = self.run.get("utc_offset_ns", "")
        self.utc_offset_ns: Final = int(offset) if offset.isdecimal() else first_ns
        """The platform's time 0 in UTC; in a foreign log, its first message."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file."""
        if isinstance(self._data, mmap):
            self._data.close()

    # --- what there is ---

    def metadata(self, name: str) -> dict[str, str] | None:
        """The last metadata record of that name."""
        found = [record.metadata for record in self._scan.metadata if record.name == name]
        return found[-1] if found else None

    @property
    def all_metadata(self) -> list[tuple[str, dict[str, str]]]:
        """All metadata records, in the order of writing."""
        return [(record.name, record.metadata) for record in self._scan.metadata]

    @property
    def attachments(self) -> dict[str, bytes]:
        """The attached files by name."""
        return {record.name: record.data for record in self._scan.attachments}

    @property
    def writer(self) -> str:
        """The program that wrote the file, as far as it says so."""
        return self._scan.library or "another program"

    def require_ours(self, needed: str, *patterns: str) -> None:
        """Requires a log of GLOC3 that has one of some topics.

        Args:
            needed: what is read from them.
            patterns: the topics without the platform's name; none if there need not be any.

        Raises:
            Refused: another program wrote the log, or it has none of the topics.
        """
        if self.is_foreign:
            raise Refused(
                f"{self.path}: written by {self.writer}, not by GLOC3: it has no {needed}. "
                "`gloc3 log info` lists its topics, `gloc3 log plot FILE TOPIC` draws one in JSON"
            )
        if patterns and not any(self._is_wanted(identifier, patterns) for identifier in self._scan.channels):
            raise Refused(f"{self.path}: has no {needed}: no topic {' or '.join(patterns)} is recorded in it")

    @property
    def platform(self) -> str:
        """Platform name from the log, or from its first message."""
        first = next(
            (info.source.platform for info in map(self.channel, self._scan.channels) if info.source.platform), ""
        )
        return self.run.get("platform") or first

    @property
    def topics(self) -> list[str]:
        """The topics that have channels, sorted."""
        return sorted({channel.topic for channel in self._scan.channels.values()})

    def channel(self, identifier: int) -> ChannelInfo:
        """What is known of a channel."""
        record = self._scan.channels[identifier]
        meta = record.metadata
        boot = meta.get("boot", "")
        source = Source(meta.get("platform", ""), meta.get("component", ""), int(boot) if boot.isdecimal() else 0)
        return ChannelInfo(record.topic, record.message_encoding, source, meta.get("type", ""), meta.get("frame", ""))

    @property
    def scan(self) -> Scan:
        """The table of the file's records."""
        return self._scan

    # --- messages ---

    def chunks(self) -> Iterator[tuple[Chunk, list[RawMessage]]]:
        """The messages chunk by chunk, without those that no channel describes (which are counted)."""
        self._orphans = 0
        for chunk in self._scan.chunks:
            messages = self._scan.messages(chunk)
            known = [message for message in messages if message.channel in self._scan.channels]
            self._orphans += len(messages) - len(known)
            yield chunk, known

    def entries(self, *patterns: str) -> Iterator[LoggedMessage]:
        """The messages in the order of recording.

        Args:
            patterns: topics without the platform's name, where `*` is one level; none for all.
        """
        self._unreadable = 0
        infos: dict[int, ChannelInfo | None] = {}
        for _, messages in self.chunks():
            for message in messages:
                identifier = message.channel
                if identifier not in infos:  # a chunk may describe its channels itself
                    infos[identifier] = self.channel(identifier) if self._is_wanted(identifier, patterns) else None
                info = infos[identifier]
                entry = self._restore(message, info) if info is not None else None
                if entry is not None:
                    yield entry

    def values(self, topic: str) -> Iterator[tuple[str, float, Any]]:
        """The messages of a topic as dictionaries and plain values, in the order of recording.

        Args:
            topic: its name, without the platform's.

        Yields:
            The publisher with its life ("" in a foreign log), the time of validity in s, and the message.

        Raises:
            Refused: a foreign log's topic is not in JSON.
        """
        if not self.is_foreign:
            for _, envelope in self.entries(topic):
                source = envelope.source
                yield f"{source.component}, {source.boot:08x}", envelope.t_s, msgspec.to_builtins(envelope.payload)
            return
        wanted = {key for key, record in self._scan.channels.items() if below(record.topic) == topic}
        for encoding in {self._scan.channels[key].message_encoding for key in wanted} - {"json"}:
            raise Refused(f"{topic} is encoded in {encoding or 'an unnamed form'}: only topics in JSON can be drawn")
        self._unreadable = 0
        for _, messages in self.chunks():
            for message in messages:
                if message.channel in wanted:
                    try:
                        yield "", self.seconds(message.log_ns), msgspec.json.decode(message.data)
                    except (ValueError, RecursionError):
                        self._unreadable += 1

    def frames(self) -> Iterator[MavlinkFrame]:
        """The raw MAVLink frames in the order of recording."""
        for _, messages in self.chunks():
            for message in messages:
                record = self._scan.channels[message.channel]
                if record.message_encoding == "mavlink":
                    meta = record.metadata
                    yield MavlinkFrame(
                        self.seconds(message.log_ns), meta.get("link", ""), meta.get("direction", ""), message.data
                    )

    def seconds(self, time_ns: int) -> float:
        """The platform's time of a time in UTC."""
        return (time_ns - self.utc_offset_ns) / 1e9

    def _is_wanted(self, identifier: int, patterns: tuple[str, ...]) -> bool:
        record: Channel = self._scan.channels[identifier]
        if not _is_ours(record):
            return False
        name = below(record.topic)
        return not patterns or any(matches(pattern, name) for pattern in patterns)

    def _restore(self, message: RawMessage, info: ChannelInfo) -> LoggedMessage | None:
        decoder = self._decoders.get(message.channel)
        if decoder is None:
            decoder = self._decoders[message.channel] = self._decoder(message.channel, info)
        try:
            t_s, payload, source, frame = decoder.decode(message.data)
        except (ValueError, RecursionError):
            self._unreadable += 1
            return None
        envelope = Envelope(
            info.topic,
            info.source if source is None else Source(*source),
            message.sequence,
            t_s,
            info.frame if frame is None else frame,
            info.type,
            payload,
        )
        return LoggedMessage(self.seconds(message.log_ns), envelope)

    def _decoder(self, identifier: int, info: ChannelInfo) -> PayloadDecoder:
        message_type: type[Message] | None
        try:
            message_type = self._types.find(info.type)
        except WireError:
            message_type = None
        schema = self._scan.schemas.get(self._scan.channels[identifier].schema_id)
        return PayloadDecoder(message_type, _VIEW_FIELDS.get(schema.name, ()) if schema else ())

    # --- what there is not ---

    def losses(self) -> list[str]:
        """What cannot be read, in sentences; complete only after the messages have been read once."""
        found = [self._describe(gap.offset, gap.end, gap.reason) for gap in self._scan.gaps]
        if self._scan.is_altered and not found:
            found.append("the checksum of the whole file is wrong: a few bytes were changed")
        if not self.is_finished:
            found.append(self._describe_end())
        if not self.run and not self.is_foreign:
            found.append("the log's description record is lost: times count from 1970")
        if self._orphans:
            found.append(f"{self._orphans} messages are lost with the description of their channel")
        if self._unreadable:
            found.append(f"{self._unreadable} messages are malformed")
        return found

    def _describe_end(self) -> str:
        if self._scan.is_complete:
            return "the index at the end is incomplete: no message is lost"
        last = max((chunk.end_ns for chunk in self._scan.chunks), default=0)
        until = f"ends at {self.seconds(last):.3f} s" if last else "has no message"
        return f"the file is not finished, its process was killed or is still writing: it {until}"

    def _describe(self, offset: int, end: int, reason: str) -> str:
        before = [chunk.end_ns for chunk in self._scan.chunks if chunk.end <= offset and chunk.end_ns]
        after = [chunk.start_ns for chunk in self._scan.chunks if chunk.offset >= end and chunk.end_ns]
        since = f"after {self.seconds(max(before)):.3f} s" if before else "from the beginning"
        until = f"before {self.seconds(min(after)):.3f} s" if after else "to the end"
        return f"{reason} at byte {offset}: {end - offset} bytes are lost, {since} and {until}"
