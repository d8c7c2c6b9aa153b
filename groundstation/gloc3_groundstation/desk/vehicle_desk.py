"""Services of one vehicle on the desk: each request becomes a job whose outcome is reported as text."""

import asyncio
from contextlib import suppress
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from gloc3.cli.counting import counted
from gloc3.errors import Refused
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.calibration import (
    LEAST_PULSE_US,
    MOST_PULSE_US,
    CalibrationKind,
    CalibrationPhase,
    CalibrationState,
    RadioChannel,
    Side,
    SideState,
)
from gloc3.mavlink.services.plan import PlanType
from gloc3.messages.envelope import Severity
from gloc3_groundstation.desk.console_desk import ConsoleDesk
from gloc3_groundstation.desk.control import require_control
from gloc3_groundstation.desk.motor_desk import MotorDesk
from gloc3_groundstation.desk.parameter_desk import ParameterDesk
from gloc3_groundstation.desk.plan_desk import PlanDesk
from gloc3_groundstation.desk.service_jobs import JobOutcome, Jobs, ServiceJob, ServiceKind, Work, attempt
from gloc3_groundstation.services.files import Folder
from gloc3_groundstation.services.logs import LogLine
from gloc3_groundstation.services.progress import JobProgress, OnProgress
from gloc3_groundstation.services.rates import RateTable
from gloc3_groundstation.services.snapshot import Firmware, ServicesSnapshot
from gloc3_groundstation.services.vehicle import VehicleServices
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store.download_progress import DownloadProgress
from gloc3_groundstation.store.log_pull import FtpCarrier, LogPuller

COMPANION: Final = 191
"""The onboard computer among the components of its vehicle."""

__all__ = [
    "LEAST_PULSE_US",
    "MOST_PULSE_US",
    "CalibrationKind",
    "CalibrationPhase",
    "CalibrationState",
    "Firmware",
    "JobOutcome",
    "PlanType",
    "RadioChannel",
    "ServiceJob",
    "ServiceKind",
    "Side",
    "SideState",
    "VehicleDesk",
]


class VehicleDesk:
    """One vehicle's services; what was listed or fetched stays at hand until it is requested again.

    Args:
        station: is told what was changed on the vehicle.
        services: of the vehicle.
        folder: for what is downloaded, and where file names that are typed begin.
    """

    def __init__(self, station: Station, services: VehicleServices, folder: Path) -> None:
        self.name = ""
        """Under which the vehicle is known to the fleet."""
        self.folder: Final = folder
        self.jobs: Final = Jobs()
        self.parameters: Final = ParameterDesk(self.begin, services.parameters)
        self.plans: Final = PlanDesk(self.begin, services.plans)
        self.console: Final = ConsoleDesk(self.begin, services.console)
        self.motors: Final = MotorDesk(self.begin, services.motors, station.now_s)
        self.logs: tuple[LogLine, ...] | None = None
        """The newest first; None until they were listed."""
        self.listing: Folder | None = None
        """Displayed folder of the vehicle; None until it is listed."""
        self.calibration: CalibrationState | None = None
        """The calibration that runs, or the last one."""
        self._station = station
        self.services: Final = services
        self._learning = asyncio.get_running_loop().create_task(attempt(self._learn()))

    @property
    def snapshot(self) -> ServicesSnapshot:
        """What is known of the vehicle."""
        return self.services.snapshots

    @property
    def is_armed(self) -> bool:
        """Whether a change requires confirmation."""
        return self.snapshot.is_armed

    @property
    def now_s(self) -> float:
        """The station's time."""
        return self._station.now_s()

    @property
    def rates(self) -> RateTable:
        """Which messages come now."""
        return self.services.rates.table

    def path(self, typed: str) -> Path:
        """Path of a typed file name: relative to the desk's folder, or to the home folder with `~`."""
        return self.folder / Path(typed.strip()).expanduser()

    def begin(
        self,
        service: ServiceKind,
        what: str,
        work: Work,
        *,
        is_change: bool = False,
        needs_control: bool | None = None,
    ) -> None:
        """Begins something; what changes the vehicle becomes an event, and is refused without control of it.

        Args:
            service: whose job it is.
            what: text until the work reports its progress.
            work: the work.
            is_change: whether it changes the vehicle.
            needs_control: whether this station must be in control; None for what changes the vehicle.
        """

        async def permitted(report: OnProgress) -> str:
            if is_change if needs_control is None else needs_control:
                require_control(self._station, self.name)
            return await work(report)

        self.jobs.begin(service, what, permitted, self._note if is_change else None)

    # --- logs ---

    def list_logs(self) -> None:
        """Lists the vehicle's logs."""

        async def work(report: OnProgress) -> str:
            found = await self.services.logs.list(report)
            self.logs = tuple(replace(line, file_name=f"{self.name}_{line.file_name}") for line in found)
            return counted(len(self.logs), "log") if self.logs else "the vehicle has no logs"

        self.begin(ServiceKind.LOGS, "listing the logs", work)

    def download_log(self, line: LogLine) -> None:
        """Downloads a log into the folder; resumes a partial download."""

        async def work(report: OnProgress) -> str:
            return f"log {line.entry.number} is in {await self.services.logs.download(line, self.folder, report)}"

        self.begin(ServiceKind.LOGS, f"downloading log {line.entry.number}", work)

    def pull_logs(self) -> None:
        """Downloads the finished logs of the onboard computer, see `log_pull`; cancelling keeps partial logs."""

        async def work(report: OnProgress) -> str:
            services, folder = self.services, self.folder / self.name

            pace = DownloadProgress()

            def came(name: str, here: int, size: int) -> None:
                words, fraction = pace.words(here, size, self.now_s), here / size if size else 1.0
                report(JobProgress(what=f"fetching {name}", fraction=fraction, detail=words.partition(" % of ")[2]))

            def reported(text: str) -> None:
                pace.reset()
                report(JobProgress(what="fetching the onboard computer's logs", detail=text))

            carrier = FtpCarrier(services.machines, services.ftp, Address(services.target.system, COMPANION))
            puller = LogPuller(self._station, self.name, carrier, came, reported)
            folder.mkdir(parents=True, exist_ok=True)
            await puller.cut()
            pulled = []
            for log in await puller.list():
                if not log.is_open and log.name.endswith(".mcap"):
                    pace.reset()
                    pulled.append(await puller.pull(log, folder))
            if not pulled:
                return f"the onboard computer of {self.name} has no finished logs"
            left = sum(not one.is_deleted for one in pulled)
            there = f"{left} stay onboard" if left else "deleted onboard"
            return f"{counted(len(pulled), 'log')} of the onboard computer: in {folder}, digests equal, {there}"

        what = "fetching the onboard computer's logs"
        self.begin(ServiceKind.LOGS, what, work, is_change=True, needs_control=False)

    def erase_logs(self) -> None:
        """Has the vehicle erase all its logs."""

        async def work(report: OnProgress) -> str:
            del report
            self.services.logs.erase_all()
            self.logs = None
            return "erasing all logs was requested; list them again to check"

        self.begin(ServiceKind.LOGS, "erasing the logs", work, is_change=True)

    # --- files ---

    def list_folder(self, path: str) -> None:
        """Looks into a folder of the vehicle."""

        async def work(report: OnProgress) -> str:
            del report
            return await self._open_log(path)

        self.begin(ServiceKind.FILES, f"listing {path}", work)

    def download_file(self, path: str) -> None:
        """Downloads a file into the folder; resumes a partial download."""

        async def work(report: OnProgress) -> str:
            return f"{path} is in {await self.services.files.download(path, self.folder, report)}"

        self.begin(ServiceKind.FILES, f"downloading {path}", work)

    def upload_file(self, file: Path, folder: str) -> None:
        """Uploads a file into a folder of the vehicle."""

        async def work(report: OnProgress) -> str:
            path = await self.services.files.upload(file, folder, report)
            await self._open_log(folder)
            return f"{path} is on the vehicle, checked"

        self.begin(ServiceKind.FILES, f"uploading {file.name}", work, is_change=True)

    def remove_file(self, path: str, *, is_folder: bool) -> None:
        """Removes a file, or an empty folder."""

        async def work(report: OnProgress) -> str:
            del report
            files = self.services.files
            await (files.remove_folder(path) if is_folder else files.remove(path))
            if self.listing is not None:
                await self._open_log(self.listing.path)
            return f"{path} is removed"

        self.begin(ServiceKind.FILES, f"removing {path}", work, is_change=True)

    def make_folder(self, path: str) -> None:
        """Creates a folder on the vehicle."""

        async def work(report: OnProgress) -> str:
            del report
            await self.services.files.make_folder(path)
            if self.listing is not None:
                await self._open_log(self.listing.path)
            return f"{path} is created"

        self.begin(ServiceKind.FILES, f"creating {path}", work, is_change=True)

    async def _open_log(self, path: str) -> str:
        self.listing = await self.services.files.list(path)
        folders = sum(entry.is_folder for entry in self.listing.entries)
        return f"{counted(folders, 'folder')}, {counted(len(self.listing.entries) - folders, 'file')}"

    # --- calibration ---

    def calibrate(self, kind: CalibrationKind) -> None:
        """Calibrates; the ESCs only after a confirmation that the propellers are off."""
        if kind is CalibrationKind.ESC and not self.motors.is_confirmed:
            return

        async def work(report: OnProgress) -> str:
            del report
            self.calibration = state = await self.services.calibration.run(kind, self._receive_calibration)
            if state.phase is not CalibrationPhase.DONE:
                raise Refused(f"{kind}: {state.phase}{f', {state.reason}' if state.reason else ''}")
            return f"{kind}: calibrated{f'; {state.reason}' if state.reason else ''}"

        self.calibration = None
        self.begin(ServiceKind.CALIBRATION, f"calibrating the {kind}", work, is_change=True)

    def confirm_calibration(self) -> None:
        """Confirms that the vehicle is in the requested position; without effect where none is requested."""
        with suppress(Refused):
            self.services.calibration.confirm()

    def _receive_calibration(self, state: CalibrationState) -> None:
        self.calibration = state

    # --- rates ---

    def request_rate(self, name: str, rate_hz: float | None) -> None:
        """Asks for a message at a rate: 0 for not at all, None for the usual one."""

        async def work(report: OnProgress) -> str:
            del report
            await self.services.rates.request(name, rate_hz)
            wanted = "its usual rate" if rate_hz is None else f"{rate_hz:g} Hz" if rate_hz else "not at all"
            return f"{name}: requested, {wanted}"

        self.begin(ServiceKind.RATES, f"requesting {name}", work)

    async def close(self) -> None:
        """Stops everything."""
        self._learning.cancel()
        await asyncio.gather(self._learning, return_exceptions=True)
        await self.jobs.close()

    async def _learn(self) -> str:
        return (await self.services.learn()).title

    def _note(self, outcome: JobOutcome) -> None:
        self._station.note(self.name, Severity.NOTICE if outcome.is_good else Severity.ERROR, outcome.text)
