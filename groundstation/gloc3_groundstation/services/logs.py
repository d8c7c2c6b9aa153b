"""Logs of a vehicle: list, and download with progress; an interrupted download resumes.

This uses our own log client, not MAVSDK's, which always starts at the first byte, and deletes a partial download when
it is cancelled. Over a radio a log takes an hour.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from gloc3.clock import utc_text
from gloc3.errors import Refused
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.files.log_client import LogClient, LogDownload, LogList, LogResult
from gloc3.mavlink.services.files.log_server import LogEntry
from gloc3_groundstation.services.machines import Machines
from gloc3_groundstation.services.progress import OnProgress, Quietly
from gloc3_groundstation.services.saving import Saving
from gloc3_groundstation.services.snapshot import Firmware, SnapshotService

KEEP_EVERY_S: Final = 1.0
"""Interval at which received data is written to disk, s."""
SUFFIXES: Final = {Firmware.ARDUPILOT: ".bin", Firmware.PX4: ".ulg"}


class LogLine(msgspec.Struct, frozen=True, kw_only=True):
    """A log of the vehicle."""

    entry: LogEntry
    file_name: str
    """What it is called here when it is downloaded."""

    @property
    def begun(self) -> str:
        """Start time, in UTC; empty where the vehicle did not know the time."""
        return utc_text(self.entry.utc_s) if self.entry.utc_s else ""


class LogService:
    """Lists and downloads logs. One request runs at a time."""

    def __init__(self, machines: Machines, client: LogClient, target: Address, snapshot: SnapshotService) -> None:
        self._machines = machines
        self._client = client
        self._target = target
        self._snapshot = snapshot

    async def list(self, on_progress: OnProgress | None = None) -> tuple[LogLine, ...]:
        """Lists the logs, the newest first.

        Raises:
            Refused: no answer, or another request is under way.
        """
        report = Quietly(on_progress)
        listing = self._client.list(self._target, now_s=self._machines.now_s)
        await self._finish(
            listing,
            "the logs were not listed",
            lambda: report("listing the logs", None, f"{len(listing.entries)} so far"),
        )
        suffix = SUFFIXES.get(self._snapshot.snapshot.firmware, ".log")
        entries = sorted(listing.entries.values(), key=lambda entry: entry.number, reverse=True)
        return tuple(LogLine(entry=entry, file_name=_file_name(entry, suffix)) for entry in entries)

    async def download(self, line: LogLine, folder: Path, on_progress: OnProgress | None = None) -> Path:
        """Downloads a log into a folder, where another file of its name stays; resumes an earlier partial download there.

        Returns:
            Its local path.

        Raises:
            Refused: no answer, the log is too large, or the file cannot be written; a partial download is kept.
        """
        entry, report = line.entry, Quietly(on_progress)
        saving = Saving(folder / line.file_name, f"{entry.number}-{entry.size}-{entry.utc_s}")
        download = self._client.read(self._target, entry, now_s=self._machines.now_s, begun=saving.begun())
        kept_s = self._machines.now_s
        problem: list[Refused] = []

        def poll() -> None:
            nonlocal kept_s
            fraction = download.progress
            report(
                f"downloading log {entry.number}",
                fraction,
                f"{fraction * entry.size / 1e6:.2f} of {entry.size / 1e6:.2f} MB",
            )
            if self._machines.now_s >= kept_s + KEEP_EVERY_S and download.result is None and not problem:
                kept_s = self._machines.now_s
                try:
                    saving.add(download.data, download.whole_bytes)
                except Refused as error:  # as a full disk
                    problem.append(error)

        is_over = False
        try:
            await self._finish(
                download,
                f"log {entry.number} was not downloaded",
                poll,
                lambda: download.result is not None or bool(problem),
            )
            is_over = True
        finally:
            if not is_over and not problem:
                saving.add(download.data, download.whole_bytes)
        if problem:
            raise problem[0]
        saving.finish(download.data)
        return saving.path

    def erase_all(self) -> None:
        """Asks the vehicle to erase all its logs; it does not answer, so list them again after a while."""
        self._client.erase_all(self._target)
        self._machines.settle()

    async def _finish(
        self,
        request: LogList | LogDownload,
        on_error: str,
        poll: Callable[[], None],
        is_over: Callable[[], bool] | None = None,
    ) -> None:
        try:
            await self._machines.until(is_over or (lambda: request.result is not None), poll)
        finally:
            if request.result is None:
                self._client.cancel()
                self._machines.settle()
        if request.result is not LogResult.DONE and request.result is not LogResult.CANCELLED:
            raise Refused(f"{on_error}: {request.result}")


def _file_name(entry: LogEntry, suffix: str) -> str:
    begun = utc_text(entry.utc_s, "_%Y-%m-%d_%H-%M-%S") if entry.utc_s else ""
    return f"log_{entry.number:03d}{begun}{suffix}"
