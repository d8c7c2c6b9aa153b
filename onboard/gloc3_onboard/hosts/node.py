"""A process of a platform other than the one with the autopilot's link: log, sensors and components."""

import asyncio
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import SystemRandom
from typing import Any, Final

import msgspec

from gloc3.clock import Clock
from gloc3.component.context import HostContext
from gloc3.component.memory import MemoryReserve
from gloc3.errors import Refused
from gloc3.exchange.base import Exchange
from gloc3.log.description import RunDescription
from gloc3.messages.envelope import Envelope
from gloc3.messages.hosts import HOSTS, HostStatus
from gloc3.messages.readiness import SensorCondition
from gloc3.messages.topics import TopicTable
from gloc3.platform.places import ProcessPlace, rows_at
from gloc3.platform.platform import Platform
from gloc3.platform.reader import find_platform, whole_text
from gloc3.store import RecordFile
from gloc3_onboard.assembly import host_components, watch_sensors
from gloc3_onboard.inputs import Hosting, devices_of, open_sensors
from gloc3_onboard.parts import Parts
from gloc3_onboard.process.computer import start_of_computer
from gloc3_onboard.process.event_narration import Report
from gloc3_onboard.process.log_files import LogFiles, log_stem
from gloc3_onboard.process.memory import RecordMemory
from gloc3_onboard.process.run_log import LogLimits, RunLog
from gloc3_onboard.process.runner import HostMember, Onboard
from gloc3_onboard.process.storage import PictureFolder
from gloc3_onboard.sensors.registry import SourceHost
from gloc3_onboard.sensors.rig import calibrations


class BootTime:
    """Start of the autopilot's time, from the clock host's status, for sources whose stamps are in it.

    Args:
        exchange: of this process.
        platform: the platform's name.
    """

    def __init__(self, exchange: Exchange, platform: str) -> None:
        self._boot_s: float | None = None
        exchange.subscribe(f"{platform}/{HOSTS}/*", self._receive_status)

    def t_s_of_boot(self, boot_s: float) -> float | None:
        """Platform time of a moment in the autopilot's time; None while unknown."""
        return None if self._boot_s is None else self._boot_s + boot_s

    def _receive_status(self, envelope: Envelope[Any]) -> None:
        status = envelope.payload
        if isinstance(status, HostStatus) and status.is_clock_host:
            self._boot_s = status.vehicle_boot_s


class NodeOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of a process of a platform."""

    platform: str
    """The platform file, or the name of one that is installed."""
    logs: Path
    """Folder of logs and pictures."""
    devices: tuple[str, ...] = ()
    """Sources that differ from the platform file's, as NAME=URL."""
    log_limits: LogLimits = LogLimits()


class HostNode:
    """A child process, or the main process of another host than the clock host.

    Args:
        platform: as read from the file.
        options: its options.
        place: the process within the platform.
        exchange: exchange with the other processes.
        loop: event loop with the platform's time.
        topics: the known topics.
        report: called with messages for people.

    Raises:
        InputError: a calibration cannot be used.
        Refused: a source is wrong, or the folder cannot be written.
    """

    def __init__(
        self,
        platform: Platform,
        options: NodeOptions,
        place: ProcessPlace,
        exchange: Exchange,
        loop: asyncio.AbstractEventLoop,
        topics: TopicTable,
        report: Report,
    ) -> None:
        self._platform, self._options = platform, options
        self.rows: Final = rows_at(platform, place)
        self.context: Final = HostContext(
            platform.platform, exchange, Clock(loop), loop, topics, SystemRandom(), memory=MemoryReserve()
        )
        self.parts: Final = Parts()
        folder, used = find_platform(options.platform).parent, devices_of(self.rows)
        boot = self.parts.add("boot time", BootTime(exchange, platform.platform))
        requested = [each for each in options.devices if each.partition("=")[0] in used]
        self._sensors = open_sensors(platform, used, requested, SourceHost(loop, folder, boot.t_s_of_boot))
        self._watch = watch_sensors(self.parts, self._sensors, loop.time)
        logs, self._stem = options.logs, log_stem(platform, place)
        try:
            logs.mkdir(parents=True, exist_ok=True)
            self._log = RunLog(
                LogFiles(logs, self._stem),
                options.log_limits,
                self.context.clock,
                topics,
                exchange.here,
                loop,
                {"platform": platform.platform, "host": place.host, "process": place.process},
                RunDescription(platform, whole_text(options.platform), calibrations(platform, self._sensors.rig)),
                list,
                report,
                has_links=False,
            )
        except OSError as error:
            raise Refused(f"the folder {logs} cannot be written: {error.strerror}") from error
        self.parts.add("run log", self._log)
        self._writer = ThreadPoolExecutor(1, "pictures")
        self.onboard: Onboard | None = None

    def make(self, placeholders: Sequence[HostMember] = ()) -> Onboard:
        """Creates the components, which accept commands from then on."""
        pictures = PictureFolder(
            self._options.logs / self.log.stem.replace("log", "images", 1),
            self._sensors.rig,
            self.context.clock.utc_offset,
            self.parts.add("picture writer", self._writer, self._writer.shutdown),
        )
        memory = RecordMemory(RecordFile(self._options.logs / f"{self._stem}.memory"), start_of_computer())
        devices = {**self._sensors.devices, "rig": self._sensors.rig, "pictures": pictures, "memory": memory}
        hosting = Hosting(rows=self.rows, placeholders=placeholders)
        self.onboard = host_components(self.parts, self._platform, self.context, devices, hosting)
        return self.onboard

    def sensors(self) -> list[SensorCondition]:
        """How the sensors of this process are."""
        return self._watch.conditions()

    @property
    def log(self) -> Path:
        """The data log that is being written."""
        return self._log.path

    @property
    def log_problem(self) -> str:
        """Why the log is not written any more; empty while it is."""
        return self._log.problem

    async def close(self) -> None:
        """Ends without ceremony; the log is finished."""
        self.parts.close()
        await self._log.close()
