"""What a station keeps of its platforms over its restarts: a small file of JSON, written whole or not at all."""

from pathlib import Path
from typing import TypeVar

import msgspec

T = TypeVar("T")


def read_kept(path: Path, type_: type[T]) -> dict[str, T]:
    """What was kept, by platform; nothing where there is none, or one by another version: the platforms tell when heard."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, type_])  # type: ignore[valid-type]
    except (OSError, msgspec.DecodeError):
        return {}


def write_kept(path: Path, kept: object) -> None:
    """Keeps it; a folder that cannot be written is told of by the recording."""
    fresh = path.with_suffix(".new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh.write_bytes(msgspec.json.encode(kept))
        fresh.replace(path)
    except OSError:
        return
