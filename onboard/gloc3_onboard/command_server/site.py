"""What the command interface server is given: its platform, and where it keeps what must survive the process."""

from concurrent.futures import Executor
from typing import Final

import msgspec

from gloc3.mission.executing.snapshot import Snapshot
from gloc3.platform.platform import Platform
from gloc3.store import Records, RecordStore
from gloc3_onboard.command_server.facts import KeptHome
from gloc3_onboard.command_server.log_shelf import NoShelf, Shelf
from gloc3_onboard.command_server.mission_checks import AtOnce
from gloc3_onboard.command_server.report_store import ReportStore

Mark = tuple[int, ...]


class _Kept(msgspec.Struct, frozen=True):
    """The last record of the file."""

    snapshot: Snapshot | None
    home: KeptHome | None
    holder: str = ""
    """The station that holds control."""
    computer: str = ""
    """The computer's own start in which this was kept."""


class Site:
    """The platform and its files: the journal of requests, the executor's progress with home, and the events.

    Args:
        platform: the platform file.
        journal: for the requests of stations.
        progress: for missions and home.
        reports: for what stations have been told.
        fresh_id: a random number, for reports that begin anew.
        shelf: the logs that stations may fetch.
        computer: tells this start of the computer from every other.
        worker: checks missions; without one they are checked at once.
    """

    def __init__(
        self,
        platform: Platform,
        journal: Records,
        progress: Records,
        reports: Records,
        fresh_id: int = 1,
        shelf: Shelf | None = None,
        computer: str = "",
        worker: Executor | None = None,
    ) -> None:
        self.platform: Final = platform
        self.journal: Final = RecordStore(journal, "journal of requests")
        self.reports: Final = ReportStore(reports, fresh_id, computer)
        self.shelf: Final = shelf or NoShelf()
        self.worker: Final = worker or AtOnce()
        self.problem = ""
        """Why what was kept cannot be used; empty if it can, or nothing was kept."""
        self._progress: Final = RecordStore(progress, "progress")
        self._computer: Final = computer
        self._snapshot: Snapshot | None = None
        self._home: KeptHome | None = None
        self.holder = ""
        """The station that held control when this was last kept."""

    def load(self) -> tuple[Snapshot | None, KeptHome | None]:
        """What the process before has left."""
        records = self._progress.load()
        if records:
            try:
                kept = msgspec.msgpack.decode(records[-1], type=_Kept)
            except (msgspec.DecodeError, msgspec.ValidationError) as error:
                self.problem = f"the kept progress cannot be read: {error}"
            else:
                self._snapshot, self._home, self.holder = kept.snapshot, kept.home, kept.holder
                if self._snapshot is not None and kept.computer != self._computer:
                    self._snapshot = self._snapshot.of_earlier_start()
        return self._snapshot, self._home

    @property
    def _stores(self) -> tuple[RecordStore, ...]:
        return self._progress, self.journal, self.reports.records

    def problems(self) -> list[str]:
        """Why something is not kept now, after another attempt."""
        for store in self._stores:
            store.check()
        problems = (self._progress.problem, self.journal.problem, self.reports.problem)
        return [problem for problem in problems if problem]

    def mark(self) -> Mark:
        """Numbers for all that was written so far."""
        return tuple(store.mark() for store in self._stores)

    def wait(self, mark: Mark, most_s: float) -> bool:
        """Whether nothing of that is on its way to the disk any more, after a wait of at most so long for each file."""
        return all(self._stores[at].wait(number, most_s) for at, number in enumerate(mark))

    def keep_snapshot(self, snapshot: Snapshot) -> None:
        """Has the disk keep the executor's progress."""
        self._snapshot = snapshot
        self._write()

    def keep_home(self, home: KeptHome) -> None:
        """Has the disk keep home."""
        self._home = home
        self._write()

    def keep_holder(self, holder: str) -> None:
        """Has the disk keep the holder of control."""
        self.holder = holder
        self._write()

    def _write(self) -> None:
        self._progress.rewrite([msgspec.msgpack.encode(_Kept(self._snapshot, self._home, self.holder, self._computer))])
