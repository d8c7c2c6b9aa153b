"""Recording of a session on disk: events, received messages (MCAP), and every MAVLink frame (`.tlog`).

A session has a folder in the XDG state directory. Its logs are split into parts of bounded size, and the oldest parts
of all sessions are deleted when their total exceeds the limit.
"""

import asyncio
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from gloc3.clock import Clock, utc_text
from gloc3.errors import Gloc3Error
from gloc3.exchange.base import Exchange
from gloc3.log.record import Recorder
from gloc3.mavlink.tlog import OVERHEAD_BYTES, is_secret, tlog_record
from gloc3.messages.topics import TopicTable

PART_BYTES: Final = 64 * 1024 * 1024
"""Size from which a part of a log is closed and the next one begun."""
KEPT_BYTES: Final = 2 * 1024 * 1024 * 1024
"""All sessions together; the oldest parts make room."""
POLL_PERIOD_S: Final = 1.0


class RecordingLimits(NamedTuple):
    """Limits of what is kept."""

    part_bytes: int = PART_BYTES
    kept_bytes: int = KEPT_BYTES


class SessionRecording:
    """The logs of one session."""

    def __init__(
        self,
        root: Path,
        clock: Clock,
        loop: asyncio.AbstractEventLoop,
        topics: TopicTable,
        station: str,
        reported: Callable[[str], None],
        limits: RecordingLimits = RecordingLimits(),  # noqa: B008 - immutable
    ) -> None:
        """Creates a folder for the session and begins its logs.

        Args:
            root: the folder of all sessions.
            clock: of the station.
            loop: the event loop, for timers.
            topics: which topics are logged.
            station: the station's id, for the log.
            reported: called with text for users when data can no longer be recorded.
            limits: bounds on the stored data.

        Raises:
            Gloc3Error: the folder is not writable.
        """
        self._root, self._clock, self._loop, self._topics = root, clock, loop, topics
        self._station, self._reported, self._limits = station, reported, limits
        self.folder: Final = _new_folder(root, utc_text(clock.now_s() + clock.utc_offset_s, "%Y-%m-%d_%H-%M-%S"))
        self._exchange: Exchange | None = None
        self._mcap: tuple[Path, Recorder] | None = None
        self._parts: dict[str, int] = {}
        self.events: Final[BinaryIO] = self._open("events", ".jsonl")[1]
        """File of the events; closed by the event store."""
        tlog = self._open("links", ".tlog")
        self._tlog_path, self._tlog = tlog
        self._tlog_bytes = 0
        self._problems: set[str] = set()
        self._make_room()
        self._timer = loop.call_later(POLL_PERIOD_S, self._flush)

    def attach(self, exchange: Exchange) -> None:
        """Records everything that passes the station's exchange."""
        self._exchange = exchange
        self._begin_mcap()

    def frame(self, raw: bytes) -> None:
        """Records a MAVLink frame of any link, in or out, unless it carries a key."""
        if self._tlog.closed or is_secret(raw):
            return
        try:
            self._tlog.write(tlog_record(raw, self._clock.now_s() + self._clock.utc_offset_s))
        except OSError as error:
            self._fail(f"{self._tlog_path.name} cannot be written: {error.strerror or error}")
            self._close_tlog()
            return
        self._tlog_bytes += len(raw) + OVERHEAD_BYTES

    def close(self) -> None:
        """Finishes the logs."""
        self._timer.cancel()
        self._close_tlog()
        if self._mcap is not None:
            self._mcap[1].close()
            self._mcap = None

    # --- parts ---

    def _flush(self) -> None:
        """Writes buffered data; begins new parts where the current ones are too long."""
        self._timer = self._loop.call_later(POLL_PERIOD_S, self._flush)
        if not self._tlog.closed:
            try:
                self._tlog.flush()
            except OSError as error:
                self._fail(f"{self._tlog_path.name} cannot be written: {error.strerror or error}")
        if self._tlog_bytes >= self._limits.part_bytes:
            self._close_tlog()
            self._reopen_tlog()
        if self._mcap is not None:
            path, recorder = self._mcap
            if recorder.problem:
                self._fail(recorder.problem)
            elif _size(path) >= self._limits.part_bytes:
                recorder.close()
                self._begin_mcap()

    def _reopen_tlog(self) -> None:
        try:
            self._tlog_path, self._tlog = self._open("links", ".tlog")
        except Gloc3Error as error:
            self._fail(str(error))
        self._tlog_bytes = 0
        self._make_room()

    def _begin_mcap(self) -> None:
        self._mcap = None
        try:
            path = self._next("station", ".mcap")
            recorder = Recorder(path, self._clock, self._topics, {"station": self._station})
        except Gloc3Error as error:
            self._fail(str(error))
            return
        self._mcap = (path, recorder)
        if self._exchange is not None:
            recorder.attach(self._exchange, self._loop)
        self._make_room()

    def _close_tlog(self) -> None:
        try:
            self._tlog.close()
        except OSError as error:
            self._fail(f"{self._tlog_path.name} cannot be written: {error.strerror or error}")

    def _open(self, stem: str, suffix: str) -> tuple[Path, BinaryIO]:
        path = self._next(stem, suffix)
        try:
            return path, path.open("w+b")
        except OSError as error:
            raise Gloc3Error(f"cannot write {path}: {error.strerror or error}") from error

    def _next(self, stem: str, suffix: str) -> Path:
        number = self._parts[stem] = self._parts.get(stem, 0) + 1
        return self.folder / (f"{stem}{suffix}" if number == 1 else f"{stem}-{number}{suffix}")

    def _make_room(self) -> None:
        """Removes the oldest parts of all sessions, never those that are being written."""
        current = {self._tlog_path, self.folder / "events.jsonl", *([self._mcap[0]] if self._mcap else [])}
        try:
            make_room(self._root, self._limits.kept_bytes, current)
        except OSError as error:
            self._fail(f"old logs in {self._root} cannot be removed: {error.strerror or error}")

    def _fail(self, problem: str) -> None:
        if problem not in self._problems:
            self._problems.add(problem)
            self._reported(f"recording: {problem}")


def make_room(root: Path, kept_bytes: int, current: set[Path]) -> None:
    """Removes the oldest logs below a folder until those that are left are no more than `kept_bytes`.

    Args:
        root: holds one folder a session; nothing but logs is touched.
        kept_bytes: how much may stay.
        current: logs that stay in any case.
    """
    logs = [path for suffix in (".jsonl", ".tlog", ".mcap") for path in root.glob(f"*/*{suffix}")]
    surplus = sum(_size(path) for path in logs) - kept_bytes
    for path in sorted(set(logs) - current, key=lambda path: (path.stat().st_mtime, path.name)):
        if surplus <= 0:
            return
        surplus -= _size(path)
        path.unlink()
        if not any(path.parent.iterdir()):
            path.parent.rmdir()


def default_root(environment: Mapping[str, str] = os.environ) -> Path:
    """`gloc3/station` in the XDG state directory."""
    base = environment.get("XDG_STATE_HOME", "")
    home = Path(environment.get("HOME", "~")).expanduser()
    folder = Path(base) if base.startswith("/") else home / ".local" / "state"
    return folder / "gloc3" / "station"


def _new_folder(root: Path, name: str) -> Path:
    number = 1
    while True:
        folder = root / (name if number == 1 else f"{name}_{number}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            number += 1
        except OSError as error:
            raise Gloc3Error(
                f"cannot record in {root}: {error.strerror or error} (--no-record switches it off)"
            ) from error
        else:
            return folder


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0
