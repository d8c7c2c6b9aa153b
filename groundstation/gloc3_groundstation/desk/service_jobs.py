"""Jobs of a vehicle's services, one at a time for each service, and their last outcome in words."""

import asyncio
from collections.abc import Awaitable, Callable
from enum import StrEnum
from pathlib import Path
from typing import Final, Protocol, TypeAlias

import msgspec

from gloc3.errors import Gloc3Error, InputError
from gloc3_groundstation.services.progress import JobProgress, OnProgress


class ServiceKind(StrEnum):
    """A kind of service; the text is its title."""

    PARAMETERS = "Parameters"
    PLANS = "Plans"
    LOGS = "Logs"
    FILES = "Files"
    CALIBRATION = "Calibration"
    RATES = "Rates"
    CONSOLE = "Console"
    MOTORS = "Motors"


class ServiceJob(msgspec.Struct, frozen=True, kw_only=True):
    """A running job."""

    what: str
    fraction: float | None = None
    """From 0 to 1; None while it is unknown."""
    detail: str = ""


class JobOutcome(msgspec.Struct, frozen=True, kw_only=True):
    """End of a job."""

    text: str
    is_good: bool = True
    lines: tuple[str, ...] = ()
    """Details, such as the errors of a file, line by line."""


Work: TypeAlias = Callable[[OnProgress], Awaitable[str]]
"""Does the work and returns the text to report; refusals and invalid input are reported, too."""


class JobStarter(Protocol):
    """Starts a job for a service."""

    def __call__(
        self,
        service: ServiceKind,
        what: str,
        work: Work,
        *,
        is_change: bool = False,
        needs_control: bool | None = None,
    ) -> None:
        """Starts it; changes to the vehicle are reported to all, and need control, unless `needs_control` says else."""


class Jobs:
    """Jobs of a vehicle's services; different services work side by side."""

    def __init__(self) -> None:
        self.running: Final[dict[ServiceKind, ServiceJob]] = {}
        self.outcomes: Final[dict[ServiceKind, JobOutcome]] = {}
        self._tasks: dict[ServiceKind, asyncio.Task[None]] = {}

    def begin(
        self, service: ServiceKind, what: str, work: Work, done: Callable[[JobOutcome], None] | None = None
    ) -> None:
        """Starts a job, unless one of the service is still running.

        Args:
            service: the service.
            what: text until the work reports its progress.
            work: the work.
            done: called with the outcome.
        """
        if service in self._tasks:
            busy = f"{what}: not started, {self.running[service].what} is still running (esc cancels it)"
            self.outcomes[service] = JobOutcome(text=busy, is_good=False)
            return
        self.outcomes.pop(service, None)
        self.running[service] = ServiceJob(what=what)
        self._tasks[service] = asyncio.get_running_loop().create_task(self._run(service, what, work, done))

    def end(self, service: ServiceKind, outcome: JobOutcome) -> None:
        """Tells of something that took no time."""
        self.outcomes[service] = outcome

    def cancel(self, service: ServiceKind) -> bool:
        """Cancels a service's running job; returns whether there was one."""
        task = self._tasks.get(service)
        return task is not None and task.cancel()

    async def close(self) -> None:
        """Stops everything."""
        tasks = list(self._tasks.values())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _run(
        self, service: ServiceKind, what: str, work: Work, done: Callable[[JobOutcome], None] | None
    ) -> None:
        def report(progress: JobProgress) -> None:
            self.running[service] = ServiceJob(what=progress.what, fraction=progress.fraction, detail=progress.detail)

        outcome = JobOutcome(text=f"{what}: cancelled", is_good=False)
        try:
            outcome = await attempt(work(report))
        finally:
            del self.running[service], self._tasks[service]
            self.outcomes[service] = outcome
        if done is not None:
            done(outcome)


async def attempt(work: Awaitable[str]) -> JobOutcome:
    """What becomes of some work: its word, or why it was refused."""
    try:
        return JobOutcome(text=await work)
    except InputError as error:
        lines = tuple(str(msgspec.structs.replace(one, file=Path(one.file).name)) for one in error.findings)
        return JobOutcome(
            text=lines[0] if len(lines) == 1 else f"{len(lines)} errors in the file", is_good=False, lines=lines
        )
    except Gloc3Error as error:
        return JobOutcome(text=str(error), is_good=False)
    except OSError as error:
        return JobOutcome(text=f"{error.filename or 'the file'}: {error.strerror or error}", is_good=False)
