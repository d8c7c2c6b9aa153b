"""Our own logs as recorded data: any sampler's topic, as far as the log has it."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

from gloc3.errors import Finding, InputError, nearest
from gloc3.log.reader import LogReader
from gloc3.messages.envelope import Message
from gloc3.messages.vehicle import Image, ImageRecorded
from gloc3_onboard.sources.pictures import load_picture
from gloc3_onboard.sources.replay import Recorded, matching

RECORDED: Final = "image_recorded"
"""The topic that tells of pictures on disk."""

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


def recorded_pictures(path: Path, camera: str) -> Sequence[Recorded[Image]]:
    """The pictures that a flight has put on disk, in the folder beside its log, with the times at which they were taken.

    Args:
        path: the log.
        camera: whose pictures.

    Raises:
        InputError: the file is no log, or tells of no such pictures.
    """
    folder = path.parent / path.stem.replace("log", "images", 1)
    with LogReader(path) as reader:
        entries = [
            entry.envelope for entry in reader.entries(RECORDED) if isinstance(entry.envelope.payload, ImageRecorded)
        ]
    found = [
        Recorded(envelope.t_s, partial(load_picture, folder / envelope.payload.file, camera))
        for envelope in entries
        if envelope.payload.camera == camera
    ]
    if not found:
        known = sorted({envelope.payload.camera for envelope in entries})
        message = f"no pictures of {camera!r} were recorded"
        raise InputError([Finding(file=str(path), message=message, hint=nearest(camera, known))])
    return found


def stereo_records(path: Path, topics: tuple[str, str]) -> Sequence[Recorded[tuple[Image, Image]]]:
    """The pairs of two cameras' topics that have the same time.

    Raises:
        InputError: the file is no log, or has no such topics.
    """
    left, right = (topic_records(path, topic, Image) for topic in topics)
    return matching(left, right)


def _same(message: M) -> M:
    return message
