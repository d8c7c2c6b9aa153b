"""Starts `gloc3` as a program of its own, as a terminal does, and ends it as Ctrl-C does."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

TIMEOUT_S = 120.0
ROOT = Path(__file__).parents[2]


class Program:
    """A running `gloc3 ARGUMENTS` that leads a process group, and what it has said so far.

    Args:
        arguments: behind `gloc3`.
        folder: where it runs.
        before: a program that runs it, such as `unshare`, with its arguments.
        module: what runs in place of `gloc3`.
        is_told: whether it is told lines, by `tell`.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        folder: Path,
        before: Sequence[str] = (),
        module: str = "gloc3",
        *,
        is_told: bool = False,
    ) -> None:
        self.process = subprocess.Popen(
            [*before, sys.executable, "-m", module, *arguments],
            cwd=folder,
            stdin=subprocess.PIPE if is_told else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self.lines: list[str] = []
        self._said = threading.Condition()
        self._is_over = False
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self._said:
                self.lines.append(line.rstrip())
                self._said.notify_all()
        with self._said:
            self._is_over = True
            self._said.notify_all()

    @property
    def text(self) -> str:
        """Everything that it has said."""
        return "\n".join(self.lines)

    def await_line(self, is_it: Callable[[str], bool], within_s: float = TIMEOUT_S, behind: int = 0) -> str:
        """Waits for a line, of those behind so many; fails with what was said if it does not come."""

        def find() -> str | None:
            return next((line for line in self.lines[behind:] if is_it(line)), None)

        with self._said:
            self._said.wait_for(lambda: find() is not None or self._is_over, within_s)
        found = find()
        assert found is not None, self.text
        return found

    def tell(self, line: str) -> None:
        """Types a line."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{line}\n")
        self.process.stdin.flush()

    def interrupt(self, number: int = signal.SIGINT) -> None:
        """Ctrl-C: the signal goes to the whole process group."""
        os.killpg(self.process.pid, number)

    def end(self, within_s: float = TIMEOUT_S) -> int:
        """Waits for its end; the exit code."""
        code = self.process.wait(within_s)
        self._reader.join(TIMEOUT_S)
        return code

    def close(self) -> None:
        """Lets go of what it said, after its end."""
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                pipe.close()


@contextmanager
def program(*arguments: str, folder: Path, before: Sequence[str] = (), is_told: bool = False) -> Iterator[Program]:
    """A program that is killed with everything in its group if the test does not see to its end."""
    running = Program(arguments, folder, before, is_told=is_told)
    try:
        yield running
    finally:
        if running.process.poll() is None:
            os.killpg(running.process.pid, signal.SIGKILL)
        running.end()
        running.close()


def processes_that_mention(text: str) -> list[str]:
    """Command lines of running processes that hold a text."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            line = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if folder.name.isdigit() and text in line:
            found.append(line)
    return found
