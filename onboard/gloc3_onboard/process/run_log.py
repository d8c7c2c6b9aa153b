"""The log of a run of the onboard process: a new file when one has grown large, the oldest deleted beyond a total."""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final, Literal

import msgspec

from gloc3.cli.counting import counted
from gloc3.clock import Clock
from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange.base import Exchange
from gloc3.log.description import RunDescription
from gloc3.log.disk_file import DiskFile
from gloc3.log.record import Recorder
from gloc3.log.selection import TopicChoice, merged
from gloc3.mavlink.tlog import is_secret, tlog_record
from gloc3.messages.envelope import Severity
from gloc3.messages.frames import Vector3
from gloc3.messages.topics import TopicTable
from gloc3_onboard.process.log_files import LogFiles

FLUSH_S: Final = 1.0
POLL_PERIOD_S: Final = 1.0
MEASURED_S: Final = 60.0
"""So long is the growth of the log measured."""
PRUNE_EVERY: Final = 10
"""Looks: other processes' logs grow, too."""
MEGABYTE: Final = 1_000_000
CONTINUES: Final = "continues"
"""Metadata of a log: the name of the file before it, of the same run."""


class Traffic:
    """The frames of all links of one run.

    Args:
        path: path of the `.tlog`.
        recorder: the data log; frames go to its channels `mavlink/LINK/in` and `mavlink/LINK/out`.
        clock: the process's clock.
        loop: event loop that schedules writes.
        warn: called once when writing fails.

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
        self.problem = ""
        """Why nothing is kept any more; empty while it is."""
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
        """Stops recording; `close`, which may run in a thread, writes the rest."""
        self._timer.cancel()
        self._is_kept = False

    def close(self) -> str:
        """Waits until everything is on disk.

        Returns:
            A write error that has not been reported yet; empty without one.
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
            self.problem = error.strerror or str(error)
            self._warn(self._problem(error))
        else:
            self._timer = self._loop.call_later(FLUSH_S, self._flush)

    def _problem(self, error: OSError) -> str:
        return f"{self._path} cannot be written: {error.strerror or error}"


class LogLimits(msgspec.Struct, frozen=True, kw_only=True):
    """Size limits of logs; 0 for no limit."""

    file_mb: float = 500.0
    """A file that is larger is followed by the next."""
    total_mb: float = 10_000.0
    """Beyond that the oldest are deleted."""


class RunLog:
    """Records an exchange and every MAVLink frame in `log-N.mcap` and `log-N.tlog`.

    Args:
        files: logs of the folder.
        limits: size limits.
        clock: the process's clock.
        topics: logged topics.
        exchange: recorded exchange.
        loop: the process's event loop.
        metadata: metadata of each file.
        description: written at the begin of each file.
        path: returns the path requested so far, stored at the end of each file.
        report: called with messages for people.
        has_links: whether the process has MAVLink links, whose frames are kept.

    Raises:
        Refused: the folder cannot be written.
    """

    def __init__(
        self,
        files: LogFiles,
        limits: LogLimits,
        clock: Clock,
        topics: TopicTable,
        exchange: Exchange,
        loop: asyncio.AbstractEventLoop,
        metadata: dict[str, str],
        description: RunDescription | None,
        path: Callable[[], Sequence[Vector3]],
        report: Callable[[Severity, str], None],
        *,
        has_links: bool = True,
    ) -> None:
        self._files, self._limits, self._clock, self._topics = files, limits, clock, topics
        self._exchange, self._loop, self._metadata, self._requested, self._report = (
            exchange,
            loop,
            metadata,
            path,
            report,
        )
        self._description, self._has_links = description, has_links
        self._chosen = dict(description.chosen) if description is not None else {}
        self._sizes: deque[tuple[float, int]] = deque()
        """Bytes written since the begin, once a second, for as long as growth is measured."""
        self._finished_bytes = 0
        self._closing: asyncio.Future[str] | None = None
        self._write_layout()
        self.path = files.next()
        """Of the file that is written now."""
        self._before = self.path
        self._recorder, self._traffic = self._begin(self.path, "")
        self._prune()
        self._polls = 0
        self._timer = loop.call_later(POLL_PERIOD_S, self._poll)

    @property
    def problem(self) -> str:
        """The files whose recording has ended early, each with the reason; empty while it goes on."""
        stopped = {self.path.name: self._recorder.problem}
        if self._traffic is not None:
            stopped[self.path.with_suffix(".tlog").name] = self._traffic.problem
        return "; ".join(f"{name}: {problem}" for name, problem in stopped.items() if problem)

    @property
    def unfinished(self) -> set[Path]:
        """The files that are still being written, or finished in a thread."""
        paths = {self.path} if self._closing is None or self._closing.done() else {self.path, self._before}
        return paths | {path.with_suffix(".tlog") for path in paths}

    def _write_layout(self) -> None:
        """Writes the layout for Foxglove; without it the log is as good."""
        try:
            if self._description is not None:
                self._description.write_layout(self._files.folder, self._topics)
        except OSError as error:
            self._warn(f"the layout for Foxglove cannot be written: {error.strerror or error}")

    def select(self, chosen: Mapping[str, TopicChoice]) -> Mapping[str, TopicChoice]:
        """Changes what is recorded of some topics, in later files, too.

        Raises:
            Refused: a pattern fits no topic.
        """
        self._chosen = merged(self._chosen, chosen, self._topics)
        self._recorder.select(self._chosen)
        return self._chosen

    @property
    def mb_per_min(self) -> float:
        """How fast the log and the frames beside it have grown in the last minute; 0 in the first seconds."""
        if len(self._sizes) < 2:
            return 0.0
        (begin_s, first), (end_s, last) = self._sizes[0], self._sizes[-1]
        return (last - first) / MEGABYTE * 60.0 / max(end_s - begin_s, POLL_PERIOD_S)

    def show_path(self, points_ned_m: Sequence[Vector3]) -> None:
        """Writes the path requested so far."""
        self._recorder.write_requested_path(points_ned_m)

    def cut(self) -> None:
        """Ends the current file and starts the next.

        Raises:
            Refused: the previous file is not finished yet, or recording has stopped.
        """
        if self._closing is not None and not self._closing.done():
            raise Refused("the previous log is still being finished")
        if self._recorder.problem:
            raise Refused(self._recorder.problem)
        self._go_on()

    def record_frame(self, link: str, direction: Literal["in", "out"], frame: bytes) -> None:
        """Keeps a MAVLink frame."""
        if self._traffic is not None:
            self._traffic.record_frame(link, direction, frame)

    async def close(self) -> None:
        """Finishes the last file."""
        self._timer.cancel()
        if self._closing is not None:
            await self._closing
        self._recorder.detach()
        self._warn_of(self._finish(self._recorder, self._traffic, list(self._requested())))

    def _begin(self, path: Path, before: str) -> tuple[Recorder, Traffic | None]:
        metadata = {**self._metadata, CONTINUES: before} if before else self._metadata
        recorder = Recorder(path, self._clock, self._topics, metadata, chosen=self._chosen)
        try:
            tlog = path.with_suffix(".tlog")
            traffic = Traffic(tlog, recorder, self._clock, self._loop, self._warn) if self._has_links else None
        except Refused:
            recorder.close()
            raise
        if self._description is not None:
            self._description.write(recorder)
        if path_so_far := self._requested():
            recorder.write_requested_path(path_so_far)
        recorder.attach(self._exchange, self._loop)
        return recorder, traffic

    @staticmethod
    def _finish(recorder: Recorder, traffic: Traffic | None, path: list[Vector3]) -> str:
        problem = traffic.close() if traffic is not None else ""
        recorder.write_requested_path(path)
        recorder.close()
        return problem

    def _poll(self) -> None:
        self._timer = self._loop.call_later(POLL_PERIOD_S, self._poll)
        limit = self._limits.file_mb * MEGABYTE
        try:
            paths = (self.path, self.path.with_suffix(".tlog")) if self._has_links else (self.path,)
            sizes = [path.stat().st_size for path in paths]
            size = max(sizes)
            self._measure(sum(sizes))
        except OSError:  # somebody has deleted it: what is still written goes nowhere
            size = int(limit) + 1
        self._polls += 1
        if self._polls % PRUNE_EVERY == 0:
            self._prune()
        if limit and size > limit and not self._recorder.problem and (self._closing is None or self._closing.done()):
            self._go_on()

    def _measure(self, written: int) -> None:
        """Notes how much has been written."""
        now_s = self._clock.now_s()
        self._sizes.append((now_s, self._finished_bytes + written))
        while self._sizes[0][0] < now_s - MEASURED_S:
            self._sizes.popleft()

    def _go_on(self) -> None:
        """Begins the next file at once; the one before is finished in a thread, since a disk may take long."""
        recorder, traffic, before = self._recorder, self._traffic, self.path
        self._before = before
        try:
            path = self._files.next()
            self._recorder, self._traffic = self._begin(path, before.name)
        except (Gloc3Error, OSError) as error:
            self._warn(f"{before.name} grows beyond its size limit: {error}")
            self._limits = msgspec.structs.replace(self._limits, file_mb=0.0)
            return
        self.path = path
        self._finished_bytes = self._sizes[-1][1] if self._sizes else 0
        recorder.detach()
        if traffic is not None:
            traffic.end()
        self._closing = self._loop.run_in_executor(None, self._finish, recorder, traffic, list(self._requested()))
        self._closing.add_done_callback(lambda done: self._warn_of(done.result()))
        self._prune()

    def _prune(self) -> None:
        if self._limits.total_mb:
            most = round(self._limits.total_mb * MEGABYTE)
            self._loop.run_in_executor(None, self._files.prune, most).add_done_callback(self._pruned)

    def _pruned(self, done: "asyncio.Future[list[Path]]") -> None:
        try:
            removed = [path for path in done.result() if path.suffix == ".mcap"]
        except OSError as error:
            self._warn(f"an old log cannot be deleted: {error}")
            return
        if removed:
            what = f"{counted(len(removed), 'log')} up to {removed[-1].name}"
            self._report(Severity.NOTICE, f"deleted {what}: all logs together are at most {self._limits.total_mb:g} MB")

    def _warn_of(self, problem: str) -> None:
        if problem:
            self._warn(problem)

    def _warn(self, text: str) -> None:
        self._report(Severity.WARNING, text)
