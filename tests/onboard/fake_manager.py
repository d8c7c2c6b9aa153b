"""A service manager as systemd is one: a real socket for what the service tells, a watchdog, and a restart when it ends."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

TIMEOUT_S = 60.0


class FakeManager:
    """Starts `gloc3 ARGUMENTS` with the environment of a service, and follows what it tells.

    Its journal is a file, named in `JOURNAL_STREAM` as systemd does.
    """

    def __init__(self, arguments: Sequence[str], folder: Path, *, watchdog_s: float, is_abstract: bool) -> None:
        self._arguments, self._folder, self._watchdog_s = arguments, folder, watchdog_s
        self._address = f"@gloc3-{os.getpid()}-{id(self)}" if is_abstract else str(folder / "notify")
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind("\0" + self._address[1:] if is_abstract else self._address)
        self._socket.settimeout(0.05)
        self.reported: list[tuple[int, float, str]] = []
        """The process's number, when, and a line that it told."""
        self.ends: list[int] = []
        """How each process ended: its exit code, or minus the signal."""
        self.process = self._start()
        self._is_open = True
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._follow, daemon=True)
        self._thread.start()

    def _start(self) -> "subprocess.Popen[bytes]":
        journal: IO[bytes] = (self._folder / "journal").open("ab")
        status = os.fstat(journal.fileno())
        environment = {
            **os.environ,
            "NOTIFY_SOCKET": self._address,
            "WATCHDOG_USEC": str(round(self._watchdog_s * 1e6)),
            "JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino}",
        }
        self._fed_s: float | None = None
        with journal:
            return subprocess.Popen(
                [sys.executable, "-m", "gloc3", *self._arguments],
                cwd=self._folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=journal,
                start_new_session=True,
            )

    def _follow(self) -> None:
        while self._is_open:
            try:
                text = self._socket.recv(65_536).decode()
            except TimeoutError:
                text = ""
            now_s = time.monotonic()
            with self._changed:
                number = len(self.ends)
                self.reported += [(number, now_s, line) for line in text.splitlines()]
                if "READY=1" in text or "WATCHDOG=1" in text:  # the watchdog begins with READY
                    is_watched = "READY=1" in text or self._fed_s is not None
                    self._fed_s = now_s if is_watched else None
                self._changed.notify_all()
            if self._fed_s is not None and now_s - self._fed_s > self._watchdog_s and self.process.poll() is None:
                self.process.send_signal(signal.SIGABRT)
                self.process.wait(TIMEOUT_S)
            code = self.process.poll()
            if code is not None and self._is_open:
                with self._changed:
                    self.ends.append(code)
                    self._is_open = code != 0  # Restart=on-failure
                    if self._is_open:
                        self.process = self._start()
                    self._changed.notify_all()

    def lines(self, life: int) -> list[str]:
        """What a process told, but for what only feeds the watchdog."""
        with self._changed:
            return [line for number, _, line in self.reported if number == life and line != "WATCHDOG=1"]

    def until(self, is_so: Callable[[], bool], what: str) -> None:
        """Waits until something is so; fails with the journal if it does not come."""
        end_s = time.monotonic() + TIMEOUT_S
        while not is_so():
            assert time.monotonic() < end_s, f"not within {TIMEOUT_S:g} s: {what}\n{self.journal}\n{self.reported}"
            time.sleep(0.02)

    def await_line(self, life: int, line: str) -> None:
        """Waits until a process has told this."""
        self.until(lambda: any(each.startswith(line) for each in self.lines(life)), f"{line} of process {life}")

    @property
    def journal(self) -> str:
        """Everything that was narrated."""
        return (self._folder / "journal").read_text()

    def close(self) -> None:
        """Ends it all, however it is."""
        self._is_open = False
        self._thread.join(TIMEOUT_S)
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait(TIMEOUT_S)
        self._socket.close()


@contextmanager
def service(*arguments: str, folder: Path, watchdog_s: float = 3.0, is_abstract: bool = False) -> Iterator[FakeManager]:
    """A service that runs until the end of the block."""
    manager = FakeManager(arguments, folder, watchdog_s=watchdog_s, is_abstract=is_abstract)
    try:
        yield manager
    finally:
        manager.close()
