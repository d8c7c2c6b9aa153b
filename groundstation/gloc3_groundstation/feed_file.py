"""Up to where the events of each platform have been shown, on disk, so that a restarted station shows none twice."""

import asyncio
from pathlib import Path
from typing import Final

from gloc3_groundstation.event_feed import Cursor, EventFeed
from gloc3_groundstation.kept_file import read_kept, write_kept

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
        return read_kept(self._path, Cursor)

    def _write(self) -> None:
        cursors = self.feed.cursors()
        if cursors == self._kept:
            return
        self._kept = cursors
        write_kept(self._path, cursors)
