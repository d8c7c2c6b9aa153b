"""Keeps every MAVLink frame that the onboard process hears or sends: in the data log, and as a `.tlog` beside it."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Final, Literal

from gloc3.clock import Clock
from gloc3.errors import Refused
from gloc3.log.disk_file import DiskFile
from gloc3.log.record import Recorder
from gloc3.mavlink.tlog import is_secret, tlog_record

FLUSH_S: Final = 1.0


class Traffic:
    """The frames of all links of one run.

    Args:
        path: of the `.tlog`.
        recorder: the data log; frames go to its channels `mavlink/LINK/in` and `mavlink/LINK/out`.
        clock: of the process.
        loop: wakes it to write what is in memory.
        warn: told once when the disk takes no more.

    Raises:
        Refused: the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        recorder: Recorder,
        clock: Clock,
        loop: asyncio.AbstractEventLoop,
        warn: Callable[[str], None],
    ) -> None:
        try:
            self._file = DiskFile(path)
        except OSError as error:
            raise Refused(f"{path} cannot be written: {error.strerror or error}") from error
        self._path, self._recorder, self._clock, self._loop, self._warn = path, recorder, clock, loop, warn
        self._is_kept, self._has_failed = True, False
        self._timer = loop.call_later(FLUSH_S, self._flush)

    def record_frame(self, link: str, direction: Literal["in", "out"], frame: bytes) -> None:
        """Keeps one frame, unless it carries a key."""
        if is_secret(frame):
            return
        now_s = self._clock.now_s()
        self._recorder.record_mavlink(link, direction, frame, now_s)
        if self._is_kept:
            self._file.write(tlog_record(frame, now_s + self._clock.utc_offset_s))

    def end(self) -> None:
        """Keeps nothing any more; what is in memory is written by `close`, which may be called in a thread."""
        self._timer.cancel()
        self._is_kept = False

    def close(self) -> str:
        """Waits until everything is on disk.

        Returns:
            Why it is not, where that was not told before; else nothing.
        """
        self.end()
        try:
            self._file.close()
        except OSError as error:
            return "" if self._has_failed else self._problem(error)
        return ""

    def _flush(self) -> None:
        try:
            self._file.flush()
        except OSError as error:
            self._has_failed = True
            self.end()
            self._warn(self._problem(error))
        else:
            self._timer = self._loop.call_later(FLUSH_S, self._flush)

    def _problem(self, error: OSError) -> str:
        return f"{self._path} cannot be written: {error.strerror or error}"
