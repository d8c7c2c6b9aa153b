"""Data log of a process: every message that passes its exchange, as an MCAP file for Foxglove.

One file per process and run. A channel is one topic; it names its first publisher and frame, and a record of another
one names its own. The log time is when the
message passed, the publish time is its time of validity, both in UTC with the single offset stored in the file.
Everything is on disk within a quarter of a second. In virtual time the same run produces the same bytes.
"""

import asyncio
import os
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import inf
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal, NamedTuple

import msgspec

from gloc3 import __version__
from gloc3.clock import Clock
from gloc3.errors import Gloc3Error
from gloc3.exchange.base import Exchange, Unsubscribe
from gloc3.log.disk_file import DiskFile
from gloc3.log.encoding_worker import EncodingWorker
from gloc3.log.foxglove.scene import (
    FRAMES,
    FRAMES_SCHEMA,
    SCENE,
    SCENE_SCHEMA,
    FoxgloveScene,
    path_entity,
    stamped,
)
from gloc3.log.foxglove.schemas import (
    MAP_FRAME,
    MAP_FROM_NED,
    NED_FRAME,
    PATH_SCHEMA,
    path,
    timestamp,
    transform,
)
from gloc3.log.payloads import PayloadEncoder, origin
from gloc3.log.selection import TopicChoice, period_s
from gloc3.log.writer import Compression, LogChannel, McapWriter
from gloc3.messages.envelope import Envelope, Message, Source
from gloc3.messages.frames import Vector3
from gloc3.messages.topics import TopicTable

FLUSH_S: Final = 0.25
"""How long a message stays in memory at most."""
RUN: Final = "gloc3"
"""Metadata record at the start of every log: the recorder's metadata, `utc_offset_ns`, `time`, `version`."""
MISSION: Final = "mission"
"""The metadata record of a loaded mission: `name`, `text`."""
PLATFORM_FILE: Final = "platform.yaml"
"""The attachment with the platform file, the effective configuration of the run."""
CAMERAS_FILE: Final = "cameras.json"
"""The attachment with the models of the cameras by name, as the components of the run had them."""
MEDIA_TYPES: Final = {".yaml": "application/yaml", ".json": "application/json"}
REQUESTED_PATH: Final = "requested_path"
"""Metadata record of the path requested by a mission: `points_ned_m`, JSON `[[north, east, down], ...]`."""


class TopicBytes(NamedTuple):
    """Recorded bytes of a topic."""

    messages: int
    bytes: int
    """Before compression."""


class _Route:
    """Where the messages of one topic, source and type go; no channel where they are not logged."""

    __slots__ = ("channel", "due_s", "encode", "frame", "is_shown", "is_slow", "origin", "period_s", "source", "type")

    def __init__(
        self,
        envelope: Envelope[Any],
        channel: LogChannel | None,
        encoder: PayloadEncoder,
        period_s: float = 0.0,
        origin: bytes = b"",
    ) -> None:
        self.source: Source = envelope.source
        self.type = envelope.type
        self.frame = envelope.frame
        self.channel = channel
        self.encode = encoder.encode
        self.is_slow = encoder.is_slow
        self.is_shown = isinstance(envelope.payload, FoxgloveScene.KINDS)
        """Whether it adds something to Foxglove's scene."""
        self.origin = origin
        self.period_s = period_s
        """Shortest time between two recorded messages; 0 for all of them."""
        self.due_s = -inf

    def is_due(self, t_s: float) -> bool:
        """Whether a message of that time is recorded; the mean rate is kept although times of messages jitter."""
        period_s, early_s = self.period_s, self.due_s - t_s
        if 0.25 * period_s < early_s < 2.0 * period_s:
            return False
        self.due_s = (self.due_s if abs(early_s) < period_s else t_s) + period_s
        return True


class Recorder:
    """Writes the log of one process."""

    def __init__(
        self,
        stream_or_path: BinaryIO | Path,
        clock: Clock,
        topics: TopicTable,
        metadata: Mapping[str, str],
        compression: Compression = "zstd",
        flush_s: float = FLUSH_S,
        chosen: Mapping[str, TopicChoice] | None = None,
    ) -> None:
        """Starts a log.

        Args:
            stream_or_path: destination; a stream is closed by the caller.
            clock: of the process.
            topics: which topics are logged; topics without a row are.
            metadata: description of the log, such as the platform's name; no paths, no dates.
            compression: of the messages.
            flush_s: longest time that a message stays in memory.
            chosen: patterns of topics (without the platform's name) that are recorded differently from their rows.

        Raises:
            Gloc3Error: the file cannot be written.
        """
        self._is_owner = isinstance(stream_or_path, Path)
        try:
            self._stream = self._open(stream_or_path, clock) if isinstance(stream_or_path, Path) else stream_or_path
        except OSError as error:
            raise Gloc3Error(f"cannot write the log {stream_or_path}: {error.strerror}") from error
        self._clock = clock
        self._flush_every_s = flush_s
        self._now_s = clock.now_s
        self._topics = topics
        self._chosen = dict(chosen or {})
        self._offset_ns: Final = round(clock.utc_offset_s * 1e9)
        self._writer = McapWriter(self._stream, compression)
        self._encoders: dict[type[Message], PayloadEncoder] = {}
        self._current: dict[str, _Route] = {}
        self._routes: dict[tuple[str, Source, str, str], _Route] = {}
        self._raw: dict[tuple[str, str], tuple[LogChannel, list[int]]] = {}
        self._made: dict[tuple[str, str], tuple[LogChannel, Source, str]] = {}
        """Topic and type to the channel, with its publisher and frame."""
        self._scene = FoxgloveScene()
        self._worker = EncodingWorker()
        self._channels: list[LogChannel] = []
        self._shown: dict[str, LogChannel] = {}
        self._subscriptions: list[Unsubscribe] = []
        self._timer: asyncio.TimerHandle | None = None
        self._syncing: asyncio.Future[None] | None = None
        self._flushed_s = self._now_s()
        self.unknown: list[str] = []
        """The topics that were recorded although they have no row."""
        self.lost = 0
        """Messages that were not recorded."""
        self.problem = ""
        """Why recording has ended early, such as a full disk."""
        self._is_open = True
        self._begin(metadata)

    # --- life ---

    def _begin(self, metadata: Mapping[str, str]) -> None:
        """Writes what every log begins with."""
        time = "virtual" if self._clock.is_virtual else "wall"
        own = {"time": time, "utc_offset_ns": str(self._offset_ns), "version": __version__}
        self.write_metadata(RUN, {**metadata, **own})
        self.write_transforms([transform(MAP_FRAME, NED_FRAME, (0.0, 0.0, 0.0), MAP_FROM_NED)])

    @staticmethod
    def _open(path: Path, clock: Clock) -> "BinaryIO | DiskFile":
        """Opens the file; in virtual time without a writing thread."""
        return path.open("wb") if clock.is_virtual else DiskFile(path)

    def attach(self, exchange: Exchange, loop: asyncio.AbstractEventLoop | None = None) -> None:
        """Records all messages that pass an exchange; with a loop, also flushes periodically.

        In wall time with a loop, pictures are compressed in a thread.
        """
        self._subscriptions.append(exchange.subscribe("**", self.record))
        if loop is not None and not self._clock.is_virtual:
            self._worker.start()
        if loop is not None and self._timer is None:
            self._timer = loop.call_later(self._flush_every_s, self._tick, loop)

    def flush(self, now_s: float) -> None:
        """Starts writing the buffer when it is due; call it more often than that."""
        if now_s - self._flushed_s >= 0.99 * self._flush_every_s and self._is_open:
            self._flushed_s = now_s
            try:
                self._append_encoded(is_waiting=False)
                self._writer.flush()
            except OSError as error:
                self._fail(error)

    def detach(self) -> None:
        """Records nothing any more of the exchangers; `close` may be called from a thread then."""
        for unsubscribe in self._subscriptions:
            unsubscribe()
        self._subscriptions.clear()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def close(self) -> None:
        """Finishes the file, with its index. What comes later is not recorded."""
        self.detach()
        if self._is_open:
            try:
                self._append_encoded(is_waiting=True)
                self._is_open = False
                self._writer.finish()
            except OSError as error:
                self._fail(error)
        self._worker.close()
        if self._is_owner:
            try:
                self._stream.close()
            except OSError as error:
                self._fail(error)

    def _tick(self, loop: asyncio.AbstractEventLoop) -> None:
        self._timer = loop.call_later(self._flush_every_s, self._tick, loop)  # first: a failed flush is not the last
        self.flush(self._now_s())
        if self._is_owner and not self._clock.is_virtual and (self._syncing is None or self._syncing.done()):
            # The disk may take long, and a loss of power must not take more than a second of the flight with it.
            self._syncing = loop.run_in_executor(None, _sync, self._stream)

    def _fail(self, error: OSError) -> None:
        self._is_open = False
        self.problem = f"the log cannot be written: {error.strerror or error}"

    # --- messages ---

    def record(self, envelope: Envelope[Any]) -> None:
        """Records a message, now."""
        route = self._current.get(envelope.topic)
        if (
            route is None
            or route.source is not envelope.source
            or route.type is not envelope.type
            or route.frame is not envelope.frame
        ):
            route = self._find(envelope)
        if route is None:
            self.lost += 1
            return
        channel = route.channel
        if channel is None:
            return
        if not self._is_open:
            self.lost += 1
            return
        if route.period_s and not route.is_due(envelope.t_s):
            return
        offset_ns = self._offset_ns
        try:
            publish_ns = offset_ns + round(envelope.t_s * 1e9)
            if route.is_slow and self._worker.is_running:
                self._encode_later(route, channel, envelope, publish_ns)
                return
            data = route.encode(envelope, publish_ns, route.origin)
            self._writer.append(channel, envelope.sequence, offset_ns + round(self._now_s() * 1e9), publish_ns, data)
            if route.is_shown:
                for shown in self._scene.shown(envelope):
                    self.show(*shown, envelope.t_s)
        except OSError as error:
            self._fail(error)
        except (ValueError, OverflowError, struct.error):  # a time or a sequence that no log can hold
            self.lost += 1

    def _encode_later(self, route: _Route, channel: LogChannel, envelope: Envelope[Any], publish_ns: int) -> None:
        """Has a worker encode a message; it is in the log after the next flush or picture, with the time of now."""
        self._append_encoded(is_waiting=False)  # so that those that are encoded take no room from those that wait
        log_ns = self._offset_ns + round(self._now_s() * 1e9)
        encode = partial(route.encode, envelope, publish_ns, route.origin)
        if not self._worker.submit(channel, envelope.sequence, log_ns, publish_ns, encode):
            self.lost += 1

    def _append_encoded(self, *, is_waiting: bool) -> None:
        """Appends what the worker has encoded; or waits for all of it."""
        for channel, sequence, log_ns, publish_ns, data in self._worker.take(is_waiting=is_waiting):
            if data.exception() is not None:  # such as no memory for a picture
                self.lost += 1
                continue
            try:
                self._writer.append(channel, sequence, log_ns, publish_ns, data.result())
            except (ValueError, struct.error):  # a time or a sequence that no log can hold
                self.lost += 1

    def select(self, chosen: Mapping[str, TopicChoice]) -> None:
        """Changes which topics are recorded, from now on.

        Args:
            chosen: patterns of topics (without the platform's name) that are recorded differently from their rows.
        """
        self._chosen = dict(chosen)
        self._current.clear()
        self._routes.clear()

    def record_mavlink(self, link: str, direction: Literal["in", "out"], frame: bytes, now_s: float) -> None:
        """Records a raw frame of a MAVLink link on the channel `mavlink/LINK/DIRECTION`."""
        if not self._is_open:
            self.lost += 1
            return
        now_ns = self._offset_ns + round(now_s * 1e9)
        try:
            found = self._raw.get((link, direction))
            if found is None:
                channel = self._writer.add_channel(
                    f"mavlink/{link}/{direction}", "mavlink", {"link": link, "direction": direction}
                )
                self._channels.append(channel)
                found = self._raw[link, direction] = (channel, [0])
            channel, count = found
            self._writer.append(channel, count[0], now_ns, now_ns, frame)
        except OSError as error:
            self._fail(error)
            return
        count[0] += 1

    def _find(self, envelope: Envelope[Any]) -> _Route | None:
        """Finds the route of a message that is its topic's first, or from another source than the topic's last message.

        None where the file accepts no new channel.
        """
        source = envelope.source
        key = (envelope.topic, source, envelope.frame, envelope.type)
        route = self._routes.get(key)
        if route is None:
            try:
                route = self._new_route(envelope)
            except OSError as error:
                self._fail(error)
                route = None
            if route is None:
                return None
            self._routes[key] = route
        self._current[envelope.topic] = route
        route.source, route.type, route.frame = source, envelope.type, envelope.frame
        return route

    def _new_route(self, envelope: Envelope[Any]) -> _Route | None:
        message_type, source = type(envelope.payload), envelope.source
        encoder = self._encoders.get(message_type)
        if encoder is None:
            encoder = self._encoders[message_type] = PayloadEncoder(message_type)
        row = self._topics.row(envelope.topic)
        if row is None:
            self.unknown += [] if envelope.topic in self.unknown else [envelope.topic]
        least_s = period_s(envelope.topic.partition("/")[2], row, self._chosen)
        if least_s is None:
            return _Route(envelope, None, encoder)
        if not self._is_open:
            return None
        key = envelope.topic, envelope.type
        if key in self._made:
            channel, of_channel, frame = self._made[key]
            return _Route(envelope, channel, encoder, least_s, origin(source, envelope.frame, of_channel, frame))
        metadata = {
            "platform": source.platform,
            "component": source.component,
            "boot": str(source.boot),
            "type": envelope.type,
            "frame": envelope.frame,
        }
        channel = self._writer.add_channel(envelope.topic, "json", metadata, encoder.schema)
        self._channels.append(channel)
        self._made[key] = channel, source, envelope.frame
        return _Route(envelope, channel, encoder, least_s)

    # --- beside the messages ---

    def write_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Writes a metadata record."""
        self._guarded(lambda: self._writer.add_metadata(name, values))

    def attach_file(self, name: str, data: bytes) -> None:
        """Puts a file into the log, such as the platform file."""
        now_ns = self._offset_ns + round(self._now_s() * 1e9)
        media_type = MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream")
        self._guarded(lambda: self._writer.add_attachment(name, media_type, data, now_ns))

    def write_transforms(self, transforms: Sequence[Mapping[str, Any]]) -> None:
        """Tells Foxglove where frames hang in others: `transform` makes them."""
        self.show(FRAMES, FRAMES_SCHEMA, {"transforms": transforms})

    def write_requested_path(self, points_ned_m: Sequence[Vector3]) -> None:
        """Writes the path requested by a mission so far: as metadata, and for Foxglove."""
        text = msgspec.json.encode(points_ned_m).decode()
        self.write_metadata(REQUESTED_PATH, {"points_ned_m": text})
        self.show("requested_path", PATH_SCHEMA, path(points_ned_m))
        if points_ned_m:
            self.show(SCENE, SCENE_SCHEMA, {"entities": [path_entity(points_ned_m)]})

    def show(self, topic: str, schema: Mapping[str, Any], values: dict[str, Any], t_s: float | None = None) -> None:
        """Writes something that only Foxglove reads.

        Args:
            topic: its channel.
            schema: one of Foxglove's.
            values: the message, without its time.
            t_s: its time of validity; now by default.
        """
        if not self._is_open:
            return
        now_ns = self._offset_ns + round(self._now_s() * 1e9)
        valid_ns = now_ns if t_s is None else self._offset_ns + round(t_s * 1e9)
        data = msgspec.json.encode(stamped(values, timestamp(valid_ns)))
        try:
            shown = self._shown.get(topic)
            if shown is None:
                described = (schema["title"], msgspec.json.encode(schema))
                shown = self._shown[topic] = self._writer.add_channel(topic, "json", {}, described)
            self._writer.append(shown, 0, now_ns, valid_ns, data)
        except OSError as error:
            self._fail(error)

    def statistics(self) -> dict[str, TopicBytes]:
        """What has been recorded so far, by topic."""
        found: dict[str, TopicBytes] = {}
        for channel in self._channels:
            before = found.get(channel.topic, TopicBytes(0, 0))
            count = channel.messages + len(channel.index) // 2
            found[channel.topic] = TopicBytes(before.messages + count, before.bytes + channel.bytes)
        return found

    def _guarded(self, write: Callable[[], None]) -> None:
        if not self._is_open:
            return
        try:
            write()
        except OSError as error:
            self._fail(error)


def _sync(stream: BinaryIO | DiskFile) -> None:
    """Waits, in a thread, until the written data is on disk."""
    try:
        os.fsync(stream.fileno())
    except (OSError, ValueError):  # the file has been closed meanwhile, or the next write will tell
        return
