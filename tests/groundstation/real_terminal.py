"""The station in a real terminal, for journeys: on a pty that is read as a terminal does, or under tmux."""

import fcntl
import os
import pty
import select
import shutil
import signal
import socket
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Protocol

from tests.commands.programs import TIMEOUT_S, Program, program

from gloc3_sitl.demo.demo import free_ports

from .emulator import Emulator

OWN_TERMINAL = (
    "import fcntl, os, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); os.execv(sys.executable, sys.argv[1:])"
)
"""Makes the pty the terminal of the program, so that its size and Ctrl-C come as they do from a person."""
POLL_PERIOD_S = 0.05
KEYS = {
    "enter": "\r",
    "escape": "\x1b",
    "space": " ",
    "^c": "\x03",
    "down": "\x1b[B",
    "backspace": "\x7f",
    "^s": "\x13",
}
TMUX_KEYS = {
    "enter": "Enter",
    "escape": "Escape",
    "space": "Space",
    "^c": "C-c",
    "down": "Down",
    "backspace": "BSpace",
    "^s": "C-s",
}


class RealTerminal(Protocol):
    """What a person has before them."""

    def press(self, *keys: str) -> None:
        """Presses keys: by name, or what they type."""

    def text(self) -> str:
        """What is shown now."""

    def resize(self, columns: int, lines: int) -> None:
        """Drags the window's corner."""

    def ended(self) -> int | None:
        """The exit code; None while the station runs."""


def until(terminal: RealTerminal, *texts: str, within_s: float = TIMEOUT_S) -> str:
    """Waits until the terminal shows all of some texts; what it shows then."""
    return wait(terminal, lambda shown: all(text in shown for text in texts), " and ".join(texts), within_s)


def wait(terminal: RealTerminal, is_so: Callable[[str], bool], what: str, within_s: float = TIMEOUT_S) -> str:
    """Waits until what the terminal shows is so."""
    end_s = time.monotonic() + within_s
    while not is_so(shown := terminal.text()):
        assert time.monotonic() < end_s, f"never shown: {what}\n{shown}"
        time.sleep(POLL_PERIOD_S)
    return shown


class PtyTerminal:
    """A pty, and an emulator that reads it."""

    def __init__(self, arguments: Sequence[str], folder: Path, columns: int, lines: int) -> None:
        self.emulator = Emulator(columns, lines)
        self._master, slave = pty.openpty()
        self._set_size(columns, lines)
        command = [sys.executable, "-c", OWN_TERMINAL, sys.executable, "-m", "gloc3", *arguments]
        self._process = subprocess.Popen(
            command,
            cwd=folder,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env=environment(folder),
            start_new_session=True,
        )
        os.close(slave)

    def press(self, *keys: str) -> None:
        for key in keys:
            os.write(self._master, KEYS.get(key, key).encode())
            time.sleep(POLL_PERIOD_S)

    def text(self) -> str:
        self._read()
        return self.emulator.text()

    def resize(self, columns: int, lines: int) -> None:
        self._read()
        self.emulator.resize(columns, lines)
        self._set_size(columns, lines)

    def ended(self) -> int | None:
        self._read()
        return self._process.poll()

    def close(self) -> None:
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait(TIMEOUT_S)
        os.close(self._master)

    def _read(self) -> None:
        with suppress(OSError):  # the other end has closed
            while select.select([self._master], [], [], 0.0)[0]:
                data = os.read(self._master, 1 << 16)
                if not data:
                    return
                self.emulator.feed(data)

    def _set_size(self, columns: int, lines: int) -> None:
        fcntl.ioctl(self._master, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))


class TmuxTerminal:
    """A window of a tmux server of its own."""

    def __init__(self, arguments: Sequence[str], folder: Path, columns: int, lines: int) -> None:
        self._socket, self._code = folder / "tmux", folder / "code"
        line = f"{sys.executable} -m gloc3 {' '.join(arguments)}; echo $? > {self._code}; sleep 100"
        size = ("-x", str(columns), "-y", str(lines))
        self._tmux("-f", "/dev/null", "new-session", "-d", *size, "-c", str(folder), line, env=environment(folder))

    def press(self, *keys: str) -> None:
        for key in keys:
            self._tmux("send-keys", TMUX_KEYS[key]) if key in TMUX_KEYS else self._tmux("send-keys", "-l", key)
            time.sleep(POLL_PERIOD_S)

    def text(self) -> str:
        return self._tmux("capture-pane", "-p")

    def resize(self, columns: int, lines: int) -> None:
        self._tmux("resize-window", "-x", str(columns), "-y", str(lines))

    def ended(self) -> int | None:
        text = self._code.read_text() if self._code.exists() else ""
        return int(text) if text.endswith("\n") else None

    def close(self) -> None:
        self._tmux("kill-server")

    def _tmux(self, *arguments: str, env: dict[str, str] | None = None) -> str:
        command = ["tmux", "-S", str(self._socket), *arguments]
        return subprocess.run(command, env=env, capture_output=True, text=True, check=True, timeout=TIMEOUT_S).stdout


TERMINALS: dict[str, type[PtyTerminal] | type[TmuxTerminal]] = {"pty": PtyTerminal, "tmux": TmuxTerminal}


def lack(kind: str) -> str:
    """Why a kind of terminal cannot be had here; empty where it can."""
    return "tmux is not installed here" if kind == "tmux" and shutil.which("tmux") is None else ""


def environment(folder: Path) -> dict[str, str]:
    """That of a person's shell, with a home of its own."""
    own = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "TMUX", "COLUMNS", "LINES")}
    home = {"HOME": str(folder), "XDG_STATE_HOME": str(folder / "state"), "XDG_CONFIG_HOME": str(folder / "config")}
    return {**own, **home, "TERM": "xterm-256color", "COLORTERM": "truecolor", "LC_ALL": "C.UTF-8"}


@contextmanager
def terminal(kind: str, *arguments: str, folder: Path, size: tuple[int, int] = (80, 24)) -> Iterator[RealTerminal]:
    """`gloc3 ARGUMENTS` in a terminal; killed in the end if it has not ended."""
    opened = TERMINALS[kind](arguments, folder, *size)
    try:
        yield opened
    finally:
        opened.close()


@contextmanager
def real_vehicle(folder: Path) -> Iterator[tuple[str, Program, Program]]:
    """The simulated vehicle and its onboard process; gives the station's link, and the two programs."""
    companion, ground = free_ports(2, socket.SOCK_DGRAM)
    links = ["--autopilot", f"udpin://127.0.0.1:{companion}", "--station", f"udpout://127.0.0.1:{ground}"]
    with (
        program("sitl", "--link", f"companion=udpout://127.0.0.1:{companion}", folder=folder) as sitl,
        program("onboard", "pelican_rtk", *links, "--out", "onboard", folder=folder) as onboard,
    ):
        sitl.await_line(lambda line: "companion link" in line)
        onboard.await_line(lambda line: "autopilot found" in line)
        yield f"udpin://127.0.0.1:{ground}", sitl, onboard
