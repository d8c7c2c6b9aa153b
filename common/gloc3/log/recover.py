"""Makes a finished log, with its index, from an unfinished or damaged one."""

from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from gloc3.errors import Finding, InputError
from gloc3.log.reader import LogReader
from gloc3.log.scan import Scan
from gloc3.log.writer import LogChannel, McapWriter

RECOVERED: Final = "recovered"
"""The metadata record of a recovered log: `lost`, what could not be saved."""


class Recovery(NamedTuple):
    """Result of a recovery."""

    messages: int
    losses: list[str]


def recover(source: Path, target: Path, progress: Callable[[float], None] | None = None) -> Recovery:
    """Copies the readable part of a log into a new one.

    Args:
        source: the damaged log; it is not modified.
        target: the new log; it must not exist.
        progress: called with the share that is done, 0 to 1.

    Raises:
        InputError: the source is not a log, or the target exists or cannot be written.
    """
    with LogReader(source) as reader:
        scan = reader.scan
        try:
            with target.open("xb") as stream:
                writer = McapWriter(stream, profile=scan.profile)
                for name, values in reader.all_metadata:
                    writer.add_metadata(name, values)
                for attachment in scan.attachments:
                    writer.add_attachment(attachment.name, attachment.media_type, attachment.data, attachment.log_time)
                channels: dict[int, LogChannel] = {}
                count = 0
                for chunk, messages in reader.chunks():
                    for message in messages:
                        channel = channels.get(message.channel)
                        if channel is None:
                            channel = channels[message.channel] = _copy_channel(writer, scan, message.channel)
                        writer.append(channel, message.sequence, message.log_ns, message.publish_ns, message.data)
                    writer.flush()
                    count += len(messages)
                    if progress is not None:
                        progress(chunk.end / reader.size)
                losses = reader.losses()
                writer.add_metadata(RECOVERED, {"lost": "\n".join(losses)})
                writer.finish()
        except OSError as error:
            if not isinstance(error, FileExistsError):
                target.unlink(missing_ok=True)  # half a log would stand in the way of the next attempt
            raise InputError([Finding(file=str(target), message=f"cannot be written: {error.strerror}")]) from error
    return Recovery(count, losses)


def _copy_channel(writer: McapWriter, scan: Scan, identifier: int) -> LogChannel:
    record = scan.channels[identifier]
    schema = scan.schemas.get(record.schema_id)
    if schema is None:
        return writer.add_channel(record.topic, record.message_encoding, record.metadata)
    described = (schema.name, schema.data)
    return writer.add_channel(record.topic, record.message_encoding, record.metadata, described, schema.encoding)
