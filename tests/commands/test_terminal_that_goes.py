"""A terminal that is killed, hangs or is closed leaves no station alive on its port, within a deadline."""

import os
import pty
import signal
import socket
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.commands.programs import processes_that_mention
from tests.groundstation.real_terminal import OWN_TERMINAL, environment

from gloc3_groundstation.cli.ending import CLOSES_WITHIN_S
from gloc3_sitl.demo.demo import free_ports

pytestmark = pytest.mark.sockets
SPARE_S = 10.0


@pytest.fixture(autouse=True)
def hears_hang_ups() -> Iterator[None]:
    """Programs start without an ignored SIGHUP, as in a terminal emulator, also where the tests run under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


class Emulator:
    """A terminal emulator that only reads, and the station in it.

    Args:
        folder: the station's home.
        is_controlling: whether the terminal controls the station, so that the kernel tells it when it is closed.
    """

    def __init__(self, folder: Path, *, is_controlling: bool) -> None:
        (self.port,) = free_ports(1, socket.SOCK_DGRAM)
        self.master, slave = pty.openpty()
        own = ["-c", OWN_TERMINAL, sys.executable] if is_controlling else []
        arguments = [*own, "-m", "gloc3", "station", "--no-record", "--link", f"udpin://127.0.0.1:{self.port}"]
        self.process = subprocess.Popen(
            [sys.executable, *arguments],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env=environment(folder),
            start_new_session=True,
        )
        os.close(slave)
        self.read_until(str(self.port).encode())

    def read_until(self, text: bytes) -> None:
        shown = b""
        while text not in shown:
            shown += os.read(self.master, 1 << 16)

    def is_gone(self, within_s: float) -> bool:
        """Whether the process ends within a time, and leaves the port to others."""
        try:
            self.process.wait(within_s)
        except subprocess.TimeoutExpired:
            return False
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("127.0.0.1", self.port))
        return not processes_that_mention(f"127.0.0.1:{self.port}")


@contextmanager
def emulator(folder: Path, *, is_controlling: bool) -> Iterator[Emulator]:
    opened = Emulator(folder, is_controlling=is_controlling)
    try:
        yield opened
    finally:
        if opened.process.poll() is None:
            os.killpg(opened.process.pid, signal.SIGKILL)
        opened.process.wait()


@pytest.mark.parametrize("is_controlling", [True, False])
def test_a_terminal_that_is_killed_or_closed_ends_the_station(*, is_controlling: bool, tmp_path: Path) -> None:
    with emulator(tmp_path, is_controlling=is_controlling) as one:
        os.close(one.master)
        assert one.is_gone(CLOSES_WITHIN_S + SPARE_S)


def test_a_terminal_that_takes_nothing_more_cannot_keep_the_station(tmp_path: Path) -> None:
    with emulator(tmp_path, is_controlling=True) as one:
        terminal = os.open(f"/proc/{one.process.pid}/fd/0", os.O_RDWR | os.O_NOCTTY)
        termios.tcflow(terminal, termios.TCOOFF)  # as by Ctrl-S, or an emulator that hangs
        for key in b"1234567890" * 20:
            os.write(one.master, bytes([key]))
            time.sleep(0.02)
        one.process.send_signal(signal.SIGHUP)
        assert one.is_gone(CLOSES_WITHIN_S + SPARE_S)
        os.close(terminal)
        os.close(one.master)
