"""What a process of a platform holds that is not the one with the autopilot's link: log, sensors and components."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from random import SystemRandom
from typing import Any, Final

from gloc3.clock import Clock
from gloc3.context import HostContext
from gloc3.errors import Refused
from gloc3.exchange.base import Exchange
from gloc3.messages import Severity
from gloc3.places import Place, rows_at
from gloc3.platform import Platform
from gloc3.platform_reader import find_platform
from gloc3.readiness import SensorCondition
from gloc3.topics import TopicTable
from gloc3_onboard.log_files import LogFiles, log_stem
from gloc3_onboard.nodes.boot_time import BootTime
from gloc3_onboard.rig import PlatformRig
from gloc3_onboard.run_log import LogLimits, RunLog
from gloc3_onboard.runner import Member, Onboard
from gloc3_onboard.sensor_watch import SensorWatch
from gloc3_onboard.sources.asked import source_urls
from gloc3_onboard.sources.factory import SourceHost, make_sources
from gloc3_onboard.storage import PictureFolder
from gloc3_onboard.taps import ExchangeTaps
from gloc3_onboard.viewer.catalogue import Catalogue

Say = Callable[[Severity, str], None]


class Node:
    """A child process, or the main process of another host than the clock host.

    Args:
        platform: as read from `file`.
        name: of the platform, or its file, as it was asked for.
        place: which process of it this is.
        exchange: joins it with the others.
        loop: its time is the platform's.
        topics: that are known.
        logs: folder of logs and pictures.
        devices: sources that differ from the platform file's, as NAME=URL.
        log_limits: how large logs may become.
        say: takes what a person should know.

    Raises:
        InputError: a calibration cannot be used.
        Refused: a source is wrong, or the folder cannot be written.
    """

    def __init__(
        self,
        platform: Platform,
        name: str,
        place: Place,
        exchange: Exchange,
        loop: asyncio.AbstractEventLoop,
        topics: TopicTable,
        logs: Path,
        devices: Sequence[str],
        log_limits: LogLimits,
        say: Say,
    ) -> None:
        self._platform, self._place, self._logs, self._topics = platform, place, logs, topics
        file = find_platform(name)
        self._loop, self._exchange = loop, exchange
        self.rows: Final = rows_at(platform, place)
        self.context: Final = HostContext(platform.platform, exchange, Clock(loop), loop, topics, SystemRandom())
        folder = file.parent
        self._rig = PlatformRig(platform, folder)
        used = sorted({device for row in self.rows for device in row.devices.values()})
        urls = source_urls(platform, used, [each for each in devices if each.partition("=")[0] in used])
        boot = BootTime(exchange, platform.platform)
        self._sources = make_sources(urls, SourceHost(loop, folder, boot.t_s_of_boot))
        self._watch = SensorWatch(urls, self._sources, self._rig, loop.time)
        try:
            logs.mkdir(parents=True, exist_ok=True)
            self._log = RunLog(
                LogFiles(logs, log_stem(platform, place)),
                log_limits,
                self.context.clock,
                topics,
                exchange.here,
                loop,
                {"platform": platform.platform, "host": place.host, "process": place.process},
                file.read_bytes(),
                list,
                say,
                has_links=False,
            )
        except OSError as error:
            raise Refused(f"the folder {logs} cannot be written: {error.strerror}") from error
        self.onboard: Onboard | None = None

    def make(self, led: Sequence[Member] = ()) -> Onboard:
        """Makes the components; they take commands from now on."""
        self.onboard = Onboard(self._platform, self.context, self._devices(), rows=self.rows, led=led)
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
        if self.onboard is not None:
            self.onboard.close()
        await self._log.close()

    def _devices(self) -> Mapping[str, Any]:
        pictures = self._log.path.stem.replace("log", "images", 1)
        return {
            **self._sources,
            "rig": self._rig,
            "pictures": PictureFolder(self._logs / pictures, self._rig),
            "taps": ExchangeTaps(self._exchange, self._loop, self._platform.platform),
            "catalogue": Catalogue(self._platform, self._topics),
        }
