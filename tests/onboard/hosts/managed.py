"""Programs that are started again whenever they end, as a service manager does, and the child processes of one."""

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

from tests.commands.programs import Program


class Manager:
    """Starts a program, and starts it again whenever it ends."""

    def __init__(
        self, arguments: Sequence[str], folder: Path, before: Sequence[str] = (), module: str = "gloc3"
    ) -> None:
        self._how = (tuple(arguments), folder, tuple(before), module)
        self._is_over = Event()
        self.program = Program(*self._how)
        self._said: list[str] = []
        self.code: int | None = None
        """Of the last one's end."""
        self._thread = Thread(target=self._keep, daemon=True)
        self._thread.start()

    def _keep(self) -> None:
        while True:
            self.program.process.wait()
            code = self.program.end()
            text = self.program.lines
            self.program.close()
            if self._is_over.is_set():
                self.code = code
                return
            self.program = Program(*self._how)
            self._said += text

    @property
    def lines(self) -> list[str]:
        """What all its lives have said."""
        return [*self._said, *self.program.lines]

    def end(self) -> None:
        """Has the program end in order, for good."""
        self._finish(signal.SIGTERM)

    def kill(self) -> None:
        """Ends the program at once, for good."""
        self._finish(signal.SIGKILL)

    def _finish(self, number: int) -> None:
        self._is_over.set()
        if self.program.process.poll() is None:
            self.program.interrupt(number)
        self._thread.join(30.0)


@contextmanager
def managed(
    arguments: Sequence[str], folder: Path, before: Sequence[str] = (), module: str = "gloc3"
) -> Iterator[Manager]:
    """A program that always comes back, until the end of the context."""
    manager = Manager(arguments, folder, before, module)
    try:
        yield manager
    finally:
        manager.kill()


def children_of(pid: int) -> dict[str, int]:
    """The child processes of an onboard process, by name."""
    found = {}
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            arguments = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if parent == pid and b"gloc3_onboard.hosts.child_main" in arguments:
            found[arguments[-2].decode().rpartition("/")[2]] = int(folder.name)
    return found
