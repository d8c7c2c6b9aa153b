"""A firmware's program: search, start in its own folder, and stop."""

import asyncio
import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from gloc3.errors import Refused

STOP_S: Final = 2.0
"""Time allowed for the program to stop, s; one that waits for physics does not react."""
LAST_LINES: Final = 8
_LAST_BYTES: Final = 4000
_POLL_PERIOD_S: Final = 0.02


def find_binary(names: Sequence[str], given: Path | None) -> Path:
    """Finds the program of a firmware.

    Args:
        names: names to find on PATH.
        given: path to use instead.

    Raises:
        Refused: not found; the message says what to do.
    """
    if given is not None:
        if not (given.is_file() and os.access(given, os.X_OK)):
            raise Refused(f"{given} is not a program")
        return given.absolute()
    for name in names:
        found = shutil.which(name)
        if found is not None:
            return Path(found).absolute()
    raise Refused(
        f"{' or '.join(names)} is not on PATH; docs/firmware.md says how to get it. For gloc3 sitl, give "
        "--firmware-binary FILE, or start the firmware yourself with --firmware-running"
    )


class FirmwareProcess:
    """A firmware process; its output is in `firmware.txt` in its folder.

    Args:
        command: with all arguments.
        folder: where it works and leaves its files.
        environment: beside our own.
    """

    def __init__(self, command: Sequence[str], folder: Path, environment: Mapping[str, str]) -> None:
        self.command: Final = tuple(command)
        self._folder, self._environment = folder, environment
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Starts it in its own session, unaffected by Ctrl-C; it ends with this process, even if that is killed.

        Raises:
            Refused: the system does not run it.
        """
        parent = shutil.which("setpriv")
        before = [parent, "--pdeathsig", "KILL"] if parent else []
        try:
            with (self._folder / "firmware.txt").open("wb") as file:
                self._process = subprocess.Popen(
                    [*before, *self.command],
                    cwd=self._folder,
                    env={**os.environ, **self._environment},
                    stdin=subprocess.DEVNULL,
                    stdout=file,
                    stderr=file,
                    start_new_session=True,
                )
        except OSError as error:
            raise Refused(f"{self.command[0]} cannot be started: {error.strerror}") from error

    @property
    def exit_code(self) -> int | None:
        """Exit code; None while it runs."""
        return None if self._process is None else self._process.poll()

    def output(self) -> str:
        """What it has printed so far."""
        file = self._folder / "firmware.txt"
        return file.read_bytes().decode(errors="replace") if file.exists() else ""

    def last_lines(self) -> str:
        """Returns the last lines of its output."""
        lines = self.output()[-_LAST_BYTES:].splitlines()
        return "\n".join(line for line in lines[-LAST_LINES:] if line.strip()) or "no output"

    async def stop(self) -> None:
        """Terminates it, and kills it if it does not end in time."""
        if self._process is None:
            return
        self._process.terminate()
        for _ in range(round(STOP_S / _POLL_PERIOD_S)):
            if self._process.poll() is not None:
                return
            await asyncio.sleep(_POLL_PERIOD_S)
        self.kill()

    def kill(self) -> None:
        """Kills it."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
