"""The console on the desk: lines typed into the vehicle's shell, with their history."""

from collections.abc import Sequence
from typing import Final

from gloc3_groundstation.desk.service_jobs import JobStarter, ServiceKind
from gloc3_groundstation.services.console import ConsoleService, ConsoleText
from gloc3_groundstation.services.progress import OnProgress

MOST_HISTORY: Final = 200


class ConsoleDesk:
    """The console of one vehicle.

    Args:
        begin: begins what takes time.
        service: of the vehicle.
    """

    def __init__(self, begin: JobStarter, service: ConsoleService) -> None:
        self._begin, self._service = begin, service
        self._history: list[str] = []

    @property
    def text(self) -> ConsoleText:
        """The output."""
        return self._service.text

    @property
    def is_open(self) -> bool:
        """Whether the shell has answered."""
        return self._service.is_open

    @property
    def history(self) -> Sequence[str]:
        """Lines that were typed, the oldest first."""
        return self._history

    def open(self, *, while_armed: bool = False) -> None:
        """Waits for the shell to answer."""

        async def work(report: OnProgress) -> str:
            del report
            await self._service.open(while_armed=while_armed)
            return "the shell answers"

        self._begin(ServiceKind.CONSOLE, "opening the shell", work, needs_control=True)

    def run(self, line: str, *, while_armed: bool = False) -> None:
        """Types a line."""

        async def work(report: OnProgress) -> str:
            del report
            await self._service.run(line, while_armed=while_armed)
            return f"shell: {line}"

        if self._history[-1:] != [line]:
            self._history = [*self._history, line][-MOST_HISTORY:]
        self._begin(ServiceKind.CONSOLE, f"shell: {line}", work, is_change=True)

    def interrupt(self) -> None:
        """Types Ctrl-C into an open shell."""
        if self.is_open:
            self._service.interrupt()
