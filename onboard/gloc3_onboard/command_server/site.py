"""The command interface server's settings, its platform, and the files that survive the process."""

from concurrent.futures import Executor
from typing import Annotated, Final, NamedTuple

import msgspec

from gloc3.component.settings import Bounds, Settings
from gloc3.component.workers import ImmediateExecutor
from gloc3.errors import UNREADABLE
from gloc3.mission.executing.snapshot import Snapshot
from gloc3.network.rights import Rights
from gloc3.platform.platform import Platform
from gloc3.store import DocumentFile, Records, RecordStore
from gloc3.terrain import Terrain
from gloc3_onboard.command_server.log_shelf import LogStoreBase, NoLogStore
from gloc3_onboard.command_server.report_store import ReportStore
from gloc3_onboard.command_server.vehicle_state import KeptHome

Mark = tuple[int, ...]


class ServerSettings(Settings, frozen=True):
    """Settings of the command interface server: report periods and waiting times."""

    summary_period_s: Annotated[float, Bounds(0.1, 10.0)] = 0.5
    """How often the components and the vehicle are summarised."""
    motion_period_s: Annotated[float, Bounds(0.1, 10.0)] = 0.5
    """Period of the vehicle's motion reports, in seconds."""
    site_period_s: Annotated[float, Bounds(0.5, 60.0)] = 2.0
    """Period of the reports of the vehicle's frame and home, in seconds."""
    grant_period_s: Annotated[float, Bounds(0.02, 1.0)] = 0.2
    """How often the owner of motion is repeated."""
    settle_s: Annotated[float, Bounds(0.0, 60.0)] = 1.0
    """Time after a restart in which the autopilot is observed before the stored state is restored, in seconds."""
    event_severity: Annotated[int, Bounds(0, 7)] = 5
    """Events of components that are at least so severe (MAV_SEVERITY) go to the stations."""


class _Kept(msgspec.Struct, frozen=True):
    """The last record of the file."""

    snapshot: Snapshot | None
    home: KeptHome | None
    holder: str = ""
    """The station that holds control."""
    computer: str = ""
    """The computer's own start in which this was kept."""


class Usage(msgspec.Struct, frozen=True, kw_only=True):
    """How much a vehicle was used, in all."""

    powered_s: float = 0.0
    """Run time of the onboard process, s."""
    armed_s: float = 0.0
    armings: int = 0


class Background(NamedTuple):
    """Slow work that is done outside the control loop."""

    log_store: LogStoreBase = NoLogStore()
    """The logs that stations may fetch."""
    worker: Executor = ImmediateExecutor()
    """Checks missions."""
    terrain: Terrain | None = None
    """Heights of the ground that they are checked against; None without tiles."""
    usage: DocumentFile[Usage] | None = None
    """The vehicle's hours; None where they are not kept."""


class Site:
    """The platform and its files: the journal of requests, the executor's progress with home, and the events.

    Args:
        platform: the platform file.
        journal: for the requests of stations.
        progress: for missions and home.
        reports: for what stations have been told.
        process: a random number of this process, which also numbers reports that begin anew.
        computer: tells this start of the computer from every other.
        background: has the logs, and checks missions; without one there are no logs, and checks are done at once.
    """

    def __init__(
        self,
        platform: Platform,
        journal: Records,
        progress: Records,
        reports: Records,
        process: int = 1,
        computer: str = "",
        background: Background | None = None,
    ) -> None:
        self.platform: Final = platform
        self.journal: Final = RecordStore(journal, "journal of requests")
        self.reports: Final = ReportStore(reports, process, computer)
        self.process: Final = process
        self.log_store, self.worker, self.terrain, self.usage = background or Background()
        self.problem = ""
        """Reason why the stored state cannot be used; empty if it can, or there is none."""
        self._progress: Final = RecordStore(progress, "progress")
        self._computer: Final = computer
        self.snapshot: Snapshot | None = None
        """The executor's progress, as it was kept last."""
        self._home: KeptHome | None = None
        self.holder = ""
        """The station that held control when this was last kept."""
        self.rights = Rights(platform.platform)
        """Of the members of the network; everyone's, unless the assembly replaces them."""

    def load(self) -> tuple[Snapshot | None, KeptHome | None]:
        """What the process before has left."""
        records = self._progress.load()
        if records:
            try:
                kept = msgspec.msgpack.decode(records[-1], type=_Kept)
            except UNREADABLE as error:
                self.problem = f"the stored mission progress cannot be read: {error}"
            else:
                self.snapshot, self._home, self.holder = kept.snapshot, kept.home, kept.holder
                if self.snapshot is not None and kept.computer != self._computer:
                    self.snapshot = self.snapshot.of_earlier_start()
        return self.snapshot, self._home

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
        """Whether everything up to the mark is on disk, after a wait of at most `most_s` for each file."""
        return all(self._stores[at].wait(number, most_s) for at, number in enumerate(mark))

    def keep_snapshot(self, snapshot: Snapshot) -> None:
        """Has the disk keep the executor's progress."""
        self.snapshot = snapshot
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
        self._progress.rewrite([msgspec.msgpack.encode(_Kept(self.snapshot, self._home, self.holder, self._computer))])
