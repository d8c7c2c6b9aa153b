"""Update of the services on a computer: from one version to another, and back if the new one does not work."""

import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from gloc3.clock import passed
from gloc3.errors import Refused
from gloc3_onboard.service.environments import CURRENT, Environments
from gloc3_onboard.service.status import ServiceStatus
from gloc3_onboard.service.unit import command_of, user_of

UNITS: Final = Path("/etc/systemd/system")
POLL_S: Final = 0.5
SETTLED_S: Final = 5.0
"""Time for which a service must work before it counts, s."""
MOST_STARTS: Final = 3
"""Restarts after which a service is taken to fail."""
_OWN_FOLDERS: Final = ("--out=", "--logs=")
"""Options that the unit adds."""

Report = Callable[[str], None]


class UnitState(NamedTuple):
    """State of a unit."""

    is_active: bool
    """Whether it is up and has said so."""
    restarts: int
    """Restarts since it was last started."""
    status: str
    """Its status line."""


class ServiceControl(Protocol):
    """What controls the units of this computer."""

    def read(self, unit: str) -> UnitState:
        """State of a unit."""

    def restart(self, unit: str) -> None:
        """Restarts a unit, without waiting for it."""


class Systemctl:
    """systemd's control of units."""

    def read(self, unit: str) -> UnitState:
        """State of a unit."""
        lines = self._run("show", "-p", "ActiveState,NRestarts,StatusText", unit).splitlines()
        found = dict(line.partition("=")[::2] for line in lines)
        return UnitState(found["ActiveState"] == "active", int(found["NRestarts"]), found["StatusText"])

    def restart(self, unit: str) -> None:
        """Restarts a unit, without waiting for it."""
        self._run("reset-failed", unit)
        self._run("restart", "--no-block", unit)

    @staticmethod
    def _run(*arguments: str) -> str:
        try:
            done = subprocess.run(["systemctl", *arguments], capture_output=True, text=True, check=False)
        except OSError as error:
            raise Refused(f"systemctl: {error.strerror or error}") from error
        if done.returncode != 0:
            raise Refused(f"systemctl {' '.join(arguments)}: {done.stderr.strip()}")
        return done.stdout


class Update:
    """Changes the version that the services of this computer run.

    Args:
        environments: the versions.
        control: of the services.
        report: called with each step.
        units: folder of the unit files.
    """

    def __init__(
        self, environments: Environments, control: ServiceControl, report: Report, units: Path = UNITS
    ) -> None:
        self._environments, self._control, self._report = environments, control, report
        texts = {path.name: path.read_text(encoding="utf-8") for path in sorted(units.glob("gloc3-*.service"))}
        program = str(environments.home / CURRENT / "bin" / "gloc3")
        self.units: Final[Mapping[str, str]] = {
            name: text for name, text in texts.items() if command_of(text)[:1] == (program,)
        }
        """Unit files of the services that run the version in use."""
        self.others: Final = tuple(name for name in texts if name not in self.units)
        """Services that run another program."""

    def states(self) -> Iterator[tuple[str, str]]:
        """The services that run the version in use, with their status."""
        for unit in self.units:
            state = self._control.read(unit)
            yield unit, state.status or ("up" if state.is_active else "not up")

    def check(self, version: str, *, is_forced: bool) -> None:
        """Checks a version with the options of each service, and that no vehicle is armed.

        Args:
            version: an installed one.
            is_forced: whether a service may be restarted whose vehicle's state is not known.

        Raises:
            Refused: the version does not accept them, or a vehicle is armed.
        """
        self._environments.check(version, [dry_run(text) for text in self.units.values()])
        for unit in self.units:
            state = self._control.read(unit)
            status = ServiceStatus.parse(state.status)
            is_disarmed = True if not state.is_active else None if status is None else status.is_disarmed
            if is_disarmed is False:
                raise Refused(f"{unit}: {state.status}. Land and disarm the vehicle first")
            if is_disarmed is None and not is_forced:
                raise Refused(
                    f"{unit}: whether the vehicle is disarmed is not known ({state.status or 'no status'}); "
                    "--force restarts it all the same"
                )

    async def switch(self, version: str, within_s: float) -> bool:
        """Switches to a version and restarts the services; switches back if one does not come up as it was.

        Args:
            version: an installed and checked one.
            within_s: time for all services to work.

        Returns:
            Whether the version is in use.
        """
        current, previous = self._environments.current, self._environments.previous
        failing = {unit: _failing(self._control.read(unit)) for unit in self.units}
        self._environments.switch(version, current if current != version else previous)
        try:
            reason = await self._restarted(failing, within_s)
        except BaseException as error:
            self._return(current, previous, str(error) or "interrupted")
            raise
        if reason:
            self._return(current, previous, reason)
        return not reason

    def _return(self, version: str, previous: str, reason: str) -> None:
        if not version:
            self._report(f"{reason}; there is no version to go back to")
            return
        self._report(f"{reason}: going back to gloc3 {version}")
        self._environments.switch(version, previous)
        for unit in self.units:
            self._control.restart(unit)

    async def _restarted(self, failing: Mapping[str, int | None], within_s: float) -> str:
        """Restarts the services and waits until they work; returns why one does not, or an empty text."""
        for unit in self.units:
            self._report(f"restarting {unit}")
            self._control.restart(unit)
        waited_s = settled_s = 0.0
        while settled_s < SETTLED_S and self.units:
            await passed(POLL_S)
            waited_s += POLL_S
            states = {unit: self._control.read(unit) for unit in self.units}
            for unit, state in states.items():
                if state.restarts >= MOST_STARTS:
                    return f"{unit} has ended {state.restarts} times"
            wrong = {unit: state for unit, state in states.items() if not _is_well(state, failing[unit])}
            settled_s = 0.0 if wrong else settled_s + POLL_S
            if wrong and waited_s >= within_s:
                unit, state = next(iter(wrong.items()))
                return f"{unit} does not work after {within_s:g} s ({state.status or 'no status'})"
        for unit in self.units:
            self._report(f"{unit}: {self._control.read(unit).status}")
        return ""


def dry_run(text: str) -> Sequence[str]:
    """The command that checks, without changing anything, what a unit's process would be started with."""
    _, _, platform, *options = command_of(text)
    kept = [option for option in options if not option.startswith(_OWN_FOLDERS)]
    return ["onboard", "install", platform, *kept, f"--user={user_of(text)}", "--dry-run"]


def _failing(state: UnitState) -> int | None:
    """How many components of a running service fail; None where it does not say."""
    status = ServiceStatus.parse(state.status)
    return status.failing if state.is_active and status is not None else None


def _is_well(state: UnitState, failing_before: int | None) -> bool:
    """Whether a service is up, and no more of its components fail than before."""
    if not state.is_active:
        return False
    status = ServiceStatus.parse(state.status)
    return status is not None and status.failing <= (failing_before or 0)
