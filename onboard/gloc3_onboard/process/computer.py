"""The computer of the onboard process as a device: real, or simulated in virtual time."""

import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryFile
from typing import Final

from gloc3.clock import Clock
from gloc3.errors import Refused
from gloc3.log.selection import TopicChoice, TopicLog
from gloc3.messages.readiness import ComputerState, LinkCondition, SensorCondition

MEASURED_BYTES: Final = 4_000_000
"""Size of the disk speed test: larger than a disk's buffer, small enough for a slow card."""
MEGABYTE: Final = 1e6


def write_speed_mb_s(folder: Path, size: int = MEASURED_BYTES) -> float:
    """Sustained write speed of a folder's disk, in 10^6 bytes a second; blocks during the test.

    Raises:
        OSError: the folder cannot be written.
    """
    data = os.urandom(size)
    with TemporaryFile(dir=folder) as file:
        began_s = Clock.cost_s()
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
        return size / MEGABYTE / max(1e-6, Clock.cost_s() - began_s)


def start_of_computer(of: Path = Path("/proc/sys/kernel/random/boot_id")) -> str:
    """Identifier of this boot of the computer; empty if the kernel reports none."""
    try:
        return of.read_text().strip()
    except OSError:
        return ""


class HostComputer:
    """The computer of this process.

    Args:
        folder: folder of log and pictures.
        clock: the process's clock.
        log_problem: returns why logging has stopped; empty while it runs.
        links: returns the state of the links.
        sensors: returns the conditions of the sensors.
        log: the log of the process, if it has one.
    """

    def __init__(
        self,
        folder: Path,
        clock: Clock,
        log_problem: Callable[[], str] = lambda: "",
        links: Callable[[], list[LinkCondition]] = list,
        sensors: Callable[[], list[SensorCondition]] = list,
        log: TopicLog | None = None,
    ) -> None:
        self._sensors, self._log = sensors, log
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
            log_mb_per_min=0.0 if self._log is None else round(self._log.mb_per_min, 3),
            utc_minus_t_s=round(self._clock.utc_s() - self._clock.now_s(), 3),
            links=self._links(),
            sensors=self._sensors(),
        )

    def select(self, chosen: Mapping[str, TopicChoice]) -> Mapping[str, TopicChoice]:
        """Changes what the log records.

        Raises:
            Refused: there is no log, or a pattern fits no topic.
        """
        return _select(self._log, chosen)


class SimulatedComputer:
    """The simulated computer of virtual time, without disk and with an exact clock.

    Args:
        clock: virtual clock.
        sensors: returns the conditions of the sensors.
        log: the log of the flight, if there is one.
    """

    def __init__(
        self, clock: Clock, sensors: Callable[[], list[SensorCondition]] = list, log: TopicLog | None = None
    ) -> None:
        self._clock, self._sensors, self._log = clock, sensors, log

    def state(self) -> ComputerState:
        """How it is now: only its sensors can change."""
        offset_s = round(self._clock.utc_offset_s, 3)
        return ComputerState(is_simulated=True, utc_minus_t_s=offset_s, sensors=self._sensors())

    def select(self, chosen: Mapping[str, TopicChoice]) -> Mapping[str, TopicChoice]:
        """Changes what the log records.

        Raises:
            Refused: there is no log, or a pattern fits no topic.
        """
        return _select(self._log, chosen)


def _select(log: TopicLog | None, chosen: Mapping[str, TopicChoice]) -> Mapping[str, TopicChoice]:
    if log is None:
        raise Refused("no log is being written")
    return log.select(chosen)
