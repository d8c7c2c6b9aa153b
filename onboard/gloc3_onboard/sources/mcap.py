"""Our own logs as recorded data: any sampler's topic, as far as the log has it."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from gloc3.errors import Finding, InputError, nearest
from gloc3.log.reader import LogReader
from gloc3.messages import Message
from gloc3.vehicle import Image
from gloc3_onboard.sources.replay import Recorded, matching

M = TypeVar("M", bound=Message)


def topic_records(path: Path, topic: str, kind: type[M]) -> Sequence[Recorded[M]]:
    """The messages of a topic, given below the platform's name.

    Raises:
        InputError: the file is no log, or has no such topic of this type.
    """
    with LogReader(path) as reader:
        found = [
            Recorded(entry.envelope.t_s, partial(_same, entry.envelope.payload))
            for entry in reader.entries(topic)
            if isinstance(entry.envelope.payload, kind)
        ]
        if not found:
            known = [name.partition("/")[2] for name in reader.topics]
            hint = nearest(topic, known)
            if kind is Image:
                hint = "pictures are not logged unless their topic's row says so"
            message = f"it has no {kind.__name__} in {topic!r}"
            raise InputError([Finding(file=str(path), message=message, hint=hint)])
    return sorted(found, key=lambda record: record.log_s)


def stereo_records(path: Path, topics: tuple[str, str]) -> Sequence[Recorded[tuple[Image, Image]]]:
    """The pairs of two cameras' topics that have the same time.

    Raises:
        InputError: the file is no log, or has no such topics.
    """
    left, right = (topic_records(path, topic, Image) for topic in topics)
    return matching(left, right)


def _same(message: M) -> M:
    return message
