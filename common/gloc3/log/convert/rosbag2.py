"""A log as a ROS 2 bag: a folder with an MCAP file of CDR messages, with their definitions, and `metadata.yaml`."""

from collections import Counter
from pathlib import Path
from typing import Any, Final

import yaml

from gloc3.errors import Gloc3Error, Refused
from gloc3.log.reader import LogReader
from gloc3.log.report.flight_path import read_flight_path
from gloc3.ros2.definitions import definition
from gloc3.ros2.messages import RosRecord, path, ros_records, stamp

VERSION: Final = 5
"""Of the form of `metadata.yaml`: that of ROS 2 Humble, which all later ones read."""


def write_bag(reader: LogReader, folder: Path) -> int:
    """Writes a bag; returns how many messages it has.

    Args:
        reader: the log.
        folder: made anew.

    Raises:
        Gloc3Error: mcap-ros2-support is not installed.
        Refused: the folder exists, or nothing in the log has a counterpart in ROS.
        OSError: it cannot be written.
    """
    try:
        from mcap_ros2.writer import Writer
    except ModuleNotFoundError as error:
        raise Gloc3Error('ROS 2 bags need mcap-ros2-support; install it with: pip install "gloc3[logs]"') from error
    reader.require_ours("messages that ROS has types for")
    try:
        folder.mkdir()
    except FileExistsError:
        raise Refused(f"{folder} exists already; choose another --out") from None
    file = folder / f"{folder.name}_0.mcap"
    counts: Counter[tuple[str, str]] = Counter()
    first_ns = last_ns = 0
    with file.open("wb") as stream:
        writer = Writer(stream)
        schemas: dict[str, Any] = {}

        def write(record: RosRecord, log_ns: int, publish_ns: int) -> None:
            package, _, name = record.type.partition("/")
            kind = f"{package}/msg/{name}"
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(kind, definition(record.type))
            key = record.topic, kind
            writer.write_message(record.topic, schemas[kind], record.message, log_ns, publish_ns, counts[key])
            counts[key] += 1

        requested = read_flight_path(reader).requested
        for now_s, envelope in reader.entries():
            log_ns = reader.utc_offset_ns + round(now_s * 1e9)
            if requested and not first_ns:
                write(path(reader.platform, requested, stamp(log_ns)), log_ns, log_ns)
            first_ns, last_ns = first_ns or log_ns, max(last_ns, log_ns)
            for record in ros_records(envelope, reader.utc_offset_ns):
                write(record, log_ns, reader.utc_offset_ns + round(envelope.t_s * 1e9))
        writer.finish()  # type: ignore[no-untyped-call]
    if not counts:
        file.unlink()
        folder.rmdir()
        raise Refused(f"{reader.path}: nothing in it has a counterpart in ROS")
    (folder / "metadata.yaml").write_text(yaml.safe_dump(_metadata(file.name, counts, first_ns, last_ns)))
    return counts.total()


def _metadata(file: str, counts: Counter[tuple[str, str]], first_ns: int, last_ns: int) -> dict[str, Any]:
    """What `rosbag2` reads before the messages."""
    duration, begin = {"nanoseconds": last_ns - first_ns}, {"nanoseconds_since_epoch": first_ns}
    topics = [
        {
            "topic_metadata": {"name": topic, "type": kind, "serialization_format": "cdr", "offered_qos_profiles": ""},
            "message_count": count,
        }
        for (topic, kind), count in counts.items()
    ]
    return {
        "rosbag2_bagfile_information": {
            "version": VERSION,
            "storage_identifier": "mcap",
            "duration": duration,
            "starting_time": begin,
            "message_count": counts.total(),
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file],
            "files": [{"path": file, "starting_time": begin, "duration": duration, "message_count": counts.total()}],
        }
    }
