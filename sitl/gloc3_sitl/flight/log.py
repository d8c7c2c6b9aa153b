"""The log of a flight in virtual time."""

from pathlib import Path
from typing import Final

from gloc3.component.context import HostContext
from gloc3.component.workers import ImmediateExecutor
from gloc3.log.record import PLATFORM_FILE, Recorder
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
        platform_file: stored in the log.
        mission: stored in the log as text.
    """

    def __init__(
        self, folder: Path | None, context: HostContext, metadata: dict[str, str], platform_file: bytes, mission: str
    ) -> None:
        self.path = None if folder is None else folder / "log.mcap"
        """Of the file that is being written."""
        self._context, self._metadata = context, metadata
        self._platform_file, self._mission = platform_file, mission
        self.recorder = self._open()

    def _open(self) -> Recorder | None:
        if self.path is None:
            return None
        context = self._context
        self.path.parent.mkdir(parents=True, exist_ok=True)
        recorder = Recorder(self.path, context.clock, context.topics, self._metadata, flush_s=FLUSH_S)
        recorder.attach_file(PLATFORM_FILE, "application/yaml", self._platform_file)
        recorder.attach_file("mission.yaml", "application/yaml", self._mission.encode())
        recorder.attach(context.exchange, context.loop)
        return recorder

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
