"""Logs that other programs write: by the mcap library's own writer, by Foxglove's SDK, and by rosbags."""

import io
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType, IndexType, Writer

START_NS: Final = 1_700_000_000_000_000_000
STEP_NS: Final = 50_000_000
COUNT: Final = 120
SCHEMA: Final = b'{"type":"object","properties":{"x_m":{"type":"number"}}}'


def by_library(file: Path, **how: Any) -> None:
    """A topic in JSON and one of plain bytes, as the mcap library writes them."""
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=700, **how)
        writer.start(profile="", library="a survey tool 2.0")
        thing = writer.register_channel("/thing", "json", writer.register_schema("Thing", "jsonschema", SCHEMA))
        raw = writer.register_channel("raw", "", 0)
        for index in range(COUNT):
            now_ns = START_NS + index * STEP_NS
            data = json.dumps({"x_m": 0.5 * index, "inner": {"list": [1, index]}, "text": "a"}).encode()
            writer.add_message(thing, now_ns, data, now_ns, index)
            writer.add_message(raw, now_ns, bytes([index]), now_ns, index)
        writer.add_metadata("notes", {"who": "someone"})
        writer.add_attachment(START_NS, START_NS, "notes.txt", "text/plain", b"calm")
        writer.finish()  # type: ignore[no-untyped-call]


def by_foxglove(file: Path) -> None:
    """Foxglove's own pictures of a scan, in Protobuf, and a topic in JSON."""
    from foxglove import Channel, Context, open_mcap
    from foxglove.channels import LaserScanChannel
    from foxglove.messages import LaserScan

    context = Context()
    with open_mcap(str(file), context=context):
        scans = LaserScanChannel("/scan", context=context)
        thing = Channel("/thing", schema={"type": "object", "title": "Thing"}, context=context)
        for index in range(COUNT):
            scans.log(LaserScan(ranges=[1.0, 2.0]), log_time=START_NS + index * STEP_NS)
            thing.log({"x_m": 0.5 * index}, log_time=START_NS + index * STEP_NS)


def by_rosbags(file: Path) -> None:
    """A ROS 2 bag's storage: poses in CDR."""
    import numpy as np
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as BagWriter
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_JAZZY)
    image = types.types["sensor_msgs/msg/LaserScan"]
    stamp = types.types["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
    header = types.types["std_msgs/msg/Header"](stamp=stamp, frame_id="laser")
    ranges = np.array([1.0, 2.0], np.float32)
    scan = image(header, 0.0, 1.0, 0.5, 0.0, 0.1, 0.1, 30.0, ranges, np.zeros(0, np.float32))
    folder = file.with_suffix("")
    with BagWriter(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=types)
        for index in range(COUNT):
            writer.write(connection, START_NS + index * STEP_NS, types.serialize_cdr(scan, "sensor_msgs/msg/LaserScan"))
    next(folder.glob("*.mcap")).rename(file)


NO_SUMMARY: Final[Mapping[str, Any]] = {
    "repeat_channels": False,
    "repeat_schemas": False,
    "use_statistics": False,
    "use_summary_offsets": False,
    "index_types": IndexType.NONE,
}

FOREIGN: Final[Mapping[str, Callable[[Path], None]]] = {
    "zstd": lambda file: by_library(file, compression=CompressionType.ZSTD),
    "lz4": lambda file: by_library(file, compression=CompressionType.LZ4),
    "not compressed": lambda file: by_library(file, compression=CompressionType.NONE),
    "without chunks": lambda file: by_library(file, use_chunking=False),
    "without a summary": lambda file: by_library(file, compression=CompressionType.LZ4, **NO_SUMMARY),
    "without an index of messages": lambda file: by_library(file, index_types=IndexType.CHUNK, repeat_channels=False),
    "foxglove": by_foxglove,
    "rosbags": by_rosbags,
}


def by_another(data: bytes, **how: Any) -> bytes:
    """A log as another program leaves it that copies it: message by message, with channels in the chunks."""
    out = io.BytesIO()
    writer = Writer(out, chunk_size=2000, **how)
    source = NonSeekingReader(io.BytesIO(data), validate_crcs=True)
    writer.start(profile="", library="a copier")
    for record in source.iter_metadata():
        writer.add_metadata(record.name, record.metadata)
    channels: dict[int, int] = {}
    for schema, channel, message in NonSeekingReader(io.BytesIO(data)).iter_messages(log_time_order=False):
        if channel.id not in channels:
            named = writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
            channels[channel.id] = writer.register_channel(
                channel.topic, channel.message_encoding, named, channel.metadata
            )
        writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()
