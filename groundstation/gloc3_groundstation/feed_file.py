"""Up to where the events of each platform have been shown, on disk, so that a restarted station shows none twice."""

import asyncio
from pathlib import Path
from typing import Final

import msgspec

from gloc3_groundstation.event_feed import Cursor, EventFeed

FILE: Final = "shown.json"
LOOK_EVERY_S: Final = 1.0


class FeedFile:
    """Keeps the cursors of an event feed in a file, which is written when they have changed.

    Args:
        path: the file.
        loop: wakes it.
    """

    def __init__(self, path: Path, loop: asyncio.AbstractEventLoop) -> None:
        self._path, self._loop = path, loop
        self._kept = self._read()
        self.feed: Final = EventFeed(self._kept)
        self._timer = loop.call_later(LOOK_EVERY_S, self._look)

    def close(self) -> None:
        """Writes what has changed."""
        self._timer.cancel()
        self._write()

    def _look(self) -> None:
        self._timer = self._loop.call_later(LOOK_EVERY_S, self._look)
        self._write()

    def _read(self) -> dict[str, Cursor]:
        try:
            return msgspec.json.decode(self._path.read_bytes(), type=dict[str, Cursor])
        except (OSError, msgspec.DecodeError):  # none is kept, or by another version: the platforms tell where to begin
            return {}

    def _write(self) -> None:
        cursors = self.feed.cursors()
        if cursors == self._kept:
            return
        self._kept = cursors
        fresh = self._path.with_suffix(".new")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            fresh.write_bytes(msgspec.json.encode(cursors))
            fresh.replace(self._path)
        except OSError:  # the recording says that the folder cannot be written
            return
