"""Parameters on the desk: fetch, edit, compare with a file, write the differences, save."""

from pathlib import Path
from typing import NamedTuple

from gloc3.cli.counting import counted
from gloc3.errors import Refused
from gloc3_groundstation.desk.service_jobs import JobStarter, ServiceKind
from gloc3_groundstation.services.parameter_table import DiffKind, ParameterDiff, ParameterTable
from gloc3_groundstation.services.parameters import ParameterService, WriteReport
from gloc3_groundstation.services.progress import OnProgress

FORCE = "!"
"""Behind a value: it is set beyond the bounds that the firmware describes."""


class Judged(NamedTuple):
    """Result of checking a typed value."""

    value: float = 0.0
    is_forced: bool = False
    reason: str = ""
    """Why it is not taken; empty where it is."""
    text: str = ""
    """The value as the vehicle gets it."""


class ParameterDesk:
    """Parameters of one vehicle on the desk.

    Args:
        begin: begins what takes time.
        service: of the vehicle.
    """

    def __init__(self, begin: JobStarter, service: ParameterService) -> None:
        self.diff: ParameterDiff | None = None
        """The displayed comparison with a file; None without one."""
        self.left_out: frozenset[str] = frozenset()
        """Parameters of that file that are not written to the vehicle."""
        self._begin = begin
        self._service = service

    @property
    def table(self) -> ParameterTable:
        """The parameters as they are known now."""
        return self._service.table

    def fetch(self) -> None:
        """Fetches the whole list."""

        async def work(report: OnProgress) -> str:
            table = await self._service.fetch(report)
            return counted(len(table), "parameter")

        self._begin(ServiceKind.PARAMETERS, "listing the parameters", work)

    def set(self, name: str, value: float, *, force: bool = False) -> None:
        """Sets one parameter and reads it back."""

        async def work(report: OnProgress) -> str:
            del report
            before = self.table[name].text
            row = await self._service.set(name, value, force=force)
            restart = "; it takes effect after a vehicle restart" if row.info.needs_restart else ""
            return f"{name} is {row.text} now (was {before}){restart}"

        self._begin(ServiceKind.PARAMETERS, f"setting {name}", work, is_change=True)

    def compare(self, file: Path) -> None:
        """Compares with a file; nothing is written before the operator has seen the differences."""

        async def work(report: OnProgress) -> str:
            if not self.table.is_complete:
                await self._service.fetch(report)
            self.diff, self.left_out = self._service.compare(file), frozenset()
            counts = [(len(self.diff.of(kind)), str(kind)) for kind in DiffKind if kind is not DiffKind.ONLY_ON_VEHICLE]
            return f"{file.name}: " + ", ".join(f"{count} {kind}" for count, kind in counts if count)

        self._begin(ServiceKind.PARAMETERS, f"comparing with {file.name}", work)

    def leave_out(self, name: str) -> None:
        """Excludes a parameter of the file from writing, or includes it again."""
        self.left_out ^= {name}

    def write(self) -> None:
        """Writes what differs and is not left out; what could not be written stays in the comparison."""
        diff = self.diff
        if diff is None:
            return
        changes = diff.changes(self.left_out)

        async def work(on_progress: OnProgress) -> str:
            report = await self._service.write(changes, on_progress)
            if self.diff is diff:
                self.diff = None
            words = reported(report, Path(diff.file).name)
            if report.refused:
                raise Refused(words)
            return words

        self._begin(ServiceKind.PARAMETERS, f"writing {counted(len(changes), 'parameter')}", work, is_change=True)

    def close_comparison(self) -> None:
        """Looks at the parameters again; nothing is written."""
        self.diff = None

    def save(self, file: Path) -> None:
        """Saves all parameters in the format of the file's suffix."""

        async def work(report: OnProgress) -> str:
            del report
            return f"{self._service.save(file)} parameters are in {file}"

        self._begin(ServiceKind.PARAMETERS, f"saving {file.name}", work)

    def describe(self, file: Path | None) -> None:
        """Takes titles, units and bounds from the firmware's description in a file, or from the vehicle."""

        async def work(report: OnProgress) -> str:
            count = await self._service.fetch_infos(report) if file is None else self._service.load_infos(file)
            return f"{count} of {len(self.table)} parameters are described"

        self._begin(ServiceKind.PARAMETERS, "reading the description of the parameters", work)


def reported(report: WriteReport, file: str) -> str:
    """What became of a file's values, in a sentence."""
    words = f"{file}: {counted(len(report.written), 'parameter')} set and read back"
    if report.needs_restart:
        words += f"; restart the vehicle for {', '.join(report.needs_restart)}"
    if report.refused:
        words += f"; {len(report.refused)} not: " + "; ".join(report.refused.values())
    return words


def judge(table: ParameterTable, name: str, typed: str) -> Judged:
    """What was typed for a parameter; one beyond its bounds is taken with an exclamation mark behind it."""
    text = typed.strip()
    is_forced = text.endswith(FORCE)
    try:
        value = table.parse(name, text.removesuffix(FORCE))
        wanted = table.check(name, value, force=True)
    except Refused as error:
        return Judged(reason=str(error))
    try:
        table.check(name, value, force=is_forced)
    except Refused as error:
        return Judged(reason=f"{error}; {text}{FORCE} sets it anyway")
    return Judged(value=value, is_forced=is_forced, text=table.with_value(wanted)[name].text)
