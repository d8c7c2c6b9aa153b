"""The computer that the onboard process runs on, as a device: a real one, and that of virtual time."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryFile
from typing import Final

from gloc3.clock import Clock
from gloc3.messages.readiness import ComputerState, LinkCondition, SensorCondition

MEASURED_BYTES: Final = 4_000_000
"""What is written to measure a disk: more than its own buffer takes at once, and little enough for a slow card."""
MEGABYTE: Final = 1e6


def write_speed_mb_s(folder: Path, size: int = MEASURED_BYTES) -> float:
    """How fast a folder's disk takes data for good, in 10^6 bytes a second; blocks for as long as that takes.

    Raises:
        OSError: it cannot be written.
    """
    data = os.urandom(size)
    with TemporaryFile(dir=folder) as file:
        began_s = Clock.cost_s()
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
        return size / MEGABYTE / max(1e-6, Clock.cost_s() - began_s)


def start_of_computer(of: Path = Path("/proc/sys/kernel/random/boot_id")) -> str:
    """What tells this start of the computer from every other; empty where the kernel does not say."""
    try:
        return of.read_text().strip()
    except OSError:
        return ""


class HostComputer:
    """The computer of this process.

    Args:
        folder: where log and pictures go.
        clock: the process's time.
        log_problem: tells why the log is not written any more; empty while it is.
        links: tells how the links are.
        sensors: tells how the sensors are.
    """

    def __init__(
        self,
        folder: Path,
        clock: Clock,
        log_problem: Callable[[], str] = lambda: "",
        links: Callable[[], list[LinkCondition]] = list,
        sensors: Callable[[], list[SensorCondition]] = list,
    ) -> None:
        self._sensors = sensors
        self._folder, self._clock = folder, clock
        self._log_problem, self._links = log_problem, links
        self._write_mb_s = 0.0
        self._problem = ""

    def measure(self) -> None:
        """Measures the disk; blocks."""
        if self._folder.exists() and not self._folder.is_dir():
            self._problem = f"{self._folder} exists already and is not a folder"
            return
        try:
            self._write_mb_s = write_speed_mb_s(self._place())
            self._problem = ""
        except OSError as error:
            self._problem = f"{self._folder} cannot be written: {error.strerror or error}"

    def _place(self) -> Path:
        """The folder, or where it is going to be made."""
        return next(one for one in (self._folder, *self._folder.absolute().parents) if one.is_dir())

    def state(self) -> ComputerState:
        """How it is now."""
        try:
            free_mb = shutil.disk_usage(self._place()).free / MEGABYTE
        except OSError:
            free_mb = 0.0
        return ComputerState(
            disk_free_mb=round(free_mb, 1),
            disk_write_mb_s=round(self._write_mb_s, 2),
            disk_problem=self._problem,
            log_problem=self._log_problem(),
            utc_minus_t_s=round(self._clock.utc_s() - self._clock.now_s(), 3),
            links=self._links(),
            sensors=self._sensors(),
        )


class SimulatedComputer:
    """The computer of virtual time: it has no disk, and its clock is right.

    Args:
        clock: the virtual time.
        sensors: tells how the sensors are.
    """

    def __init__(self, clock: Clock, sensors: Callable[[], list[SensorCondition]] = list) -> None:
        self._clock, self._sensors = clock, sensors

    def state(self) -> ComputerState:
        """How it is now: only its sensors can change."""
        offset_s = round(self._clock.utc_offset_s, 3)
        return ComputerState(is_simulated=True, utc_minus_t_s=offset_s, sensors=self._sensors())
