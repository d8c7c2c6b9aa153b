"""One process of the demonstration, with its output in its own file."""

import asyncio
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from gloc3.errors import Gloc3Error

STOP_S: Final = 15.0
"""How long a process may take to end when it is asked to: the onboard process sees to the vehicle first."""
READY_S: Final = 30.0
POLL_PERIOD_S: Final = 0.05
LAST_LINES: Final = 5


class DemoProcess:
    """A process that runs `gloc3 ARGUMENTS`."""

    def __init__(self, name: str, out: Path) -> None:
        self.name = name
        self._file = out / f"{name}.txt"
        self._process: asyncio.subprocess.Process | None = None

    async def start(self, arguments: Sequence[str]) -> None:
        """Starts it out of reach of the terminal's Ctrl-C, with its output in the file."""
        with self._file.open("wb") as file:
            self._process = await asyncio.create_subprocess_exec(
                *_command(arguments),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=file,
                stderr=file,
                start_new_session=True,
            )

    async def show(self, arguments: Sequence[str], *, is_interactive: bool) -> None:
        """Starts it on this process's output, and if interactive also on the terminal's input."""
        self._process = await asyncio.create_subprocess_exec(
            *_command(arguments),
            stdin=None if is_interactive else asyncio.subprocess.DEVNULL,
            start_new_session=not is_interactive,
        )

    async def wait(self) -> int:
        """Waits for its end."""
        assert self._process is not None
        return await self._process.wait()

    @property
    def is_running(self) -> bool:
        """Whether it has been started and has not ended."""
        return self._process is not None and self._process.returncode is None

    async def await_line(self, text: str) -> str:
        """Waits for a line of its output.

        Raises:
            Gloc3Error: it ended first, or took too long; with its last words.
        """
        for _ in range(round(READY_S / POLL_PERIOD_S)):
            is_running = self.is_running
            for line in self._file.read_text(errors="replace").splitlines():
                if text in line:
                    return line
            if not is_running:
                break
            await asyncio.sleep(POLL_PERIOD_S)
        raise Gloc3Error(f"{self.name} did not start: {self.last_lines()}")

    def last_lines(self) -> str:
        """Returns the last lines of its output."""
        lines = self._file.read_text(errors="replace").splitlines() if self._file.exists() else []
        return "\n".join(lines[-LAST_LINES:]) or "no output"

    async def stop(self) -> None:
        """Terminates it, and kills it if it does not end in time; while still loading it ends at once."""
        process = self._process
        if process is None:
            return
        with suppress(ProcessLookupError):
            process.terminate()
        try:
            async with asyncio.timeout(STOP_S):
                await process.wait()
        except TimeoutError:
            self.kill()
            await process.wait()

    def kill(self) -> None:
        """Kills it."""
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.kill()


def _command(arguments: Sequence[str]) -> list[str]:
    return [sys.executable, "-m", "gloc3", *arguments]
