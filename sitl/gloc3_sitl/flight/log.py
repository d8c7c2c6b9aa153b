"""The log of a flight in virtual time."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from gloc3.component.context import HostContext
from gloc3.component.workers import ImmediateExecutor
from gloc3.errors import Refused
from gloc3.log.description import RunDescription
from gloc3.log.record import Recorder
from gloc3.log.selection import TopicChoice, merged, period_s
from gloc3.messages.frames import Vector3
from gloc3_onboard.command_server.log_shelf import LogStore, LogStoreBase, NoLogStore
from gloc3_onboard.process.log_files import LogFiles

FLUSH_S: Final = 1.0
"""How long a message stays in memory: in virtual time a second is over in some milliseconds."""


class FlightRecording:
    """Logs the flight's exchange into a folder, if any; survives restarts of the onboard process.

    Args:
        folder: of the log; None to write none.
        context: the flight's context.
        metadata: the log's metadata.
        description: written at the begin of each file.
    """

    mb_per_min = 0.0
    """Not measured: it is no matter of virtual time."""

    def __init__(
        self,
        folder: Path | None,
        context: HostContext,
        metadata: dict[str, str],
        description: RunDescription,
    ) -> None:
        self.path = None if folder is None else folder / "log.mcap"
        """Of the file that is being written."""
        self._context, self._metadata = context, metadata
        self._description, self._chosen = description, dict(description.chosen)
        self.on_select: Callable[[], None] = lambda: None
        """Called when other topics are recorded from now on."""
        self.recorder = self._open()

    def _open(self) -> Recorder | None:
        if self.path is None:
            return None
        context = self._context
        self.path.parent.mkdir(parents=True, exist_ok=True)
        recorder = Recorder(
            self.path, context.clock, context.topics, self._metadata, flush_s=FLUSH_S, chosen=self._chosen
        )
        self._description.write(recorder)
        self._description.write_layout(self.path.parent, context.topics)
        recorder.attach(context.exchange, context.loop)
        return recorder

    def select(self, chosen: Mapping[str, TopicChoice]) -> Mapping[str, TopicChoice]:
        """Changes what is recorded of some topics.

        Raises:
            Refused: there is no log, or a pattern fits no topic.
        """
        if self.recorder is None:
            raise Refused("no log is being written")
        self._chosen = merged(self._chosen, chosen, self._context.topics)
        self.recorder.select(self._chosen)
        self.on_select()
        return self._chosen

    def records(self, topic: str) -> bool:
        """Whether a topic `PLATFORM/TOPIC` is recorded."""
        row, name = self._context.topics.row(topic), topic.partition("/")[2]
        return self.recorder is not None and period_s(name, row, self._chosen) is not None

    def show_path(self, points_ned_m: Sequence[Vector3]) -> None:
        """Writes the path requested so far."""
        if self.recorder is not None:
            self.recorder.write_requested_path(points_ned_m)

    def cut(self) -> None:
        """Ends the current file and starts the next."""
        if self.path is not None and self.recorder is not None:
            self.recorder.close()
            self.path = LogFiles(self.path.parent).next()
            self.recorder = self._open()

    def log_store(self) -> LogStoreBase:
        """The logs that the station may fetch."""
        if self.path is None:
            return NoLogStore()
        return LogStore(self.path.parent, self._unfinished, self.cut, ImmediateExecutor())

    def _unfinished(self) -> set[Path]:
        return set() if self.path is None else {self.path}

    def close(self) -> None:
        """Finishes the log."""
        if self.recorder is not None:
            self.recorder.close()
