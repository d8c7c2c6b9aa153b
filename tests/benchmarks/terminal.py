"""The ground station's terminal on a real pty: processor share, repaint after a key, and bytes for the terminal."""

import fcntl
import os
import pty
import select
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import termios
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import quantiles
from typing import NamedTuple

WARM_S = 20.0
"""So long a hundred vehicles take to introduce themselves; that costs twice as much as to listen to them."""
WATCH_S = 10.0
PRESSES = 40
PAUSE_S = 0.11
LONGEST_S = 30.0
"""A key that shows nothing for so long does not work; a busy machine alone is told, and ends nothing."""
SIZE = (40, 120)
MARKS = {b"2": b"errors", b"1": b"battery"}
"""A key to what only the screen that it shows says."""


class Cost(NamedTuple):
    """What the station costs under one load."""

    share: float
    """Of a core."""
    bytes_s: float
    key_s: list[float]
    """From the key that brings the next vehicle into view to its name in the title."""
    screen_s: list[float]
    """From the key of another screen to that screen."""
    switch_cpu_s: float
    """Processor time of a change of screen, beyond what listening takes meanwhile."""
    heard_hz: float
    """Summaries of a vehicle that arrive a second."""
    memory_mb: float
    echo_s: list[float]
    """In between: what a program takes that computes for 10 ms and echoes a key. It tells how quiet the machine was."""


WORK_S = 0.01
ECHO = f"""
import os, time, tty
tty.setraw(0)
while key := os.read(0, 1):
    end_s = time.process_time() + {WORK_S}
    while time.process_time() < end_s:
        pass
    os.write(1, key)
"""


class Pty:
    """A program on a pty, read as a terminal does."""

    def __init__(self, command: Sequence[str], environment: Mapping[str, str] | None = None) -> None:
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", *SIZE, 0, 0))
        self.process = subprocess.Popen(
            command, stdin=slave, stdout=slave, stderr=slave, env=environment, start_new_session=True
        )
        os.close(slave)
        self.bytes = 0

    def read(self, within_s: float) -> bytes:
        """What is written within a time; empty if nothing is."""
        ready, _, _ = select.select([self._master], [], [], within_s)
        data = os.read(self._master, 1 << 16) if ready else b""
        self.bytes += len(data)
        return data

    def read_for(self, seconds: float) -> None:
        """Reads, as a terminal does, for a time."""
        end_s = time.perf_counter() + seconds
        while (left_s := end_s - time.perf_counter()) > 0.0:
            self.read(left_s)

    def press(self, key: bytes, mark: bytes) -> float:
        """Seconds from a key to what it shows."""
        begin_s, seen = time.perf_counter(), b""
        os.write(self._master, key)
        while mark not in seen:
            if time.perf_counter() - begin_s > LONGEST_S:
                raise TimeoutError(f"{key!r} shows nothing")
            seen += self.read(1.0)
        return time.perf_counter() - begin_s

    def close(self) -> None:
        """Ends it as a closed window does."""
        self.process.terminate()
        self.process.wait(10.0)
        os.close(self._master)


class Terminal(Pty):
    """A station."""

    def __init__(self, port: int, folder: str) -> None:
        own = {"TERM": "xterm-256color", "COLORTERM": "truecolor", "XDG_STATE_HOME": folder, "XDG_CONFIG_HOME": folder}
        command = [sys.executable, "-m", "gloc3", "station", "--link", f"udpin://127.0.0.1:{port}"]
        super().__init__(command, {**os.environ, **own})

    def usage(self) -> tuple[float, float]:
        """Processor seconds so far, and resident memory in MB."""
        own = Path("/proc") / str(self.process.pid)
        fields = (own / "stat").read_text().rpartition(")")[2].split()
        pages = int((own / "statm").read_text().split()[1])
        ticks = os.sysconf("SC_CLK_TCK")
        return (int(fields[11]) + int(fields[12])) / ticks, pages * os.sysconf("SC_PAGE_SIZE") / 1e6

    def close(self) -> None:
        """Ends it with Ctrl-C."""
        self.process.send_signal(signal.SIGINT)
        while self.process.poll() is None:
            try:
                self.read(0.2)
            except OSError:
                break
        self.process.wait(10.0)
        os.close(self._master)


@contextmanager
def loaded(port: int, vehicles: int, parts: int, rate_hz: float) -> Iterator[None]:
    """Vehicles that talk to a port, in a process of their own."""
    if not vehicles:
        yield
        return
    command = [sys.executable, "-m", "tests.benchmarks.fleet_load", *map(str, (port, vehicles, parts, rate_hz))]
    load = subprocess.Popen(command)
    try:
        yield
    finally:
        load.terminate()
        load.wait(10.0)


def measure(vehicles: int, parts: int, rate_hz: float) -> Cost:
    """What a station costs that hears so many vehicles, on the screen that shows them all."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory() as folder:
        terminal, echo = Terminal(port, folder), Pty([sys.executable, "-c", ECHO])
        try:
            terminal.read_for(2.0)
            with loaded(port, vehicles, parts, rate_hz):
                loaded_s = time.perf_counter()
                terminal.read_for(WARM_S)
                before_s, before_bytes = terminal.usage()[0], terminal.bytes
                begin_s = time.perf_counter()
                terminal.read_for(WATCH_S)
                elapsed_s = time.perf_counter() - begin_s
                after_s, memory_mb = terminal.usage()
                written = terminal.bytes - before_bytes
                share, presses = (after_s - before_s) / elapsed_s, range(PRESSES if vehicles > 1 else 0)
                next_one = [(b"v", f" {(n + 1) % vehicles + 1}/{vehicles}".encode()) for n in presses]
                echoes: list[float] = []
                keys, _ = press_all(terminal, next_one, share, echo, echoes)
                other_screen = [list(MARKS.items())[n % 2] for n in presses]
                screens, switch_cpu_s = press_all(terminal, other_screen, share, echo, echoes)
        finally:
            echo.close()
            terminal.close()
        seconds = time.perf_counter() - loaded_s
        heard_hz = _summaries(Path(folder)) / seconds / max(1, vehicles)
    return Cost(share, written / elapsed_s, keys, screens, switch_cpu_s, heard_hz, memory_mb, echoes)


def press_all(
    terminal: Terminal, presses: Sequence[tuple[bytes, bytes]], share: float, echo: Pty, echoes: list[float]
) -> tuple[list[float], float]:
    """Seconds from each key to what it shows, and the processor time of one beyond the share that is taken anyway."""
    begin_s, before_s, times_s = time.perf_counter(), terminal.usage()[0], []
    for key, mark in presses:
        times_s.append(terminal.press(key, mark))
        terminal.read_for(PAUSE_S)
        echoes.append(echo.press(b"x", b"x"))
    spent_s = terminal.usage()[0] - before_s - share * (time.perf_counter() - begin_s)
    return times_s, max(0.0, spent_s) / max(1, len(presses))


def _summaries(folder: Path) -> int:
    """How many summaries the station has recorded."""
    from gloc3.log.reader import LogReader

    (file,) = folder.glob("gloc3/station/*/station.mcap")
    with LogReader(file) as log:
        return sum(1 for _ in log.entries("ci/summary"))


def p95_ms(times_s: list[float]) -> float:
    """The 95th percentile, in milliseconds."""
    return quantiles(times_s, n=20)[18] * 1e3


def run() -> list[str]:
    """One line a load."""
    lines = [f"the station's overview on a pty of {SIZE[1]}x{SIZE[0]}, over UDP, recording"]
    for name, load, bar in (
        ("nobody is heard", (0, 0, 1.0), "3"),
        ("1 vehicle x 20 components at 2 Hz", (1, 20, 2.0), ""),
        ("10 vehicles x 20 components at 10 Hz", (10, 20, 10.0), "15"),
        ("100 vehicles x 20 components at 1 Hz", (100, 20, 1.0), "30"),
    ):
        cost = measure(*load)
        limit = f" (<= {bar})" if bar else ""
        lines.append(
            f"{name:<38} {100.0 * cost.share:5.1f} % of a core{limit}   {cost.bytes_s / 1e3:5.1f} kB/s to the terminal"
            f"   {cost.memory_mb:4.0f} MB"
        )
        if cost.key_s:
            lines.append(
                f"{'':<38} key to repaint p95 {p95_ms(cost.key_s):.0f} ms (<= 50)"
                f"   another screen p95 {p95_ms(cost.screen_s):.0f} ms ({cost.switch_cpu_s * 1e3:.0f} ms of processor time)   {cost.heard_hz:.1f} summaries/s a vehicle"
                f"   10 ms of work and an echo p95 {p95_ms(cost.echo_s):.1f} ms"
            )
    return lines
