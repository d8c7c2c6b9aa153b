"""The onboard process in wall time: opens links and files, hosts the components, and stops cleanly."""

import asyncio
import signal
import sys
from pathlib import Path
from random import SystemRandom
from typing import Any, Final

import msgspec

from gloc3.clock import Clock
from gloc3.context import HostContext
from gloc3.errors import Refused
from gloc3.exchange import LocalExchange
from gloc3.link.endpoints import Endpoint, open_endpoint
from gloc3.messages import Envelope, Event, Severity
from gloc3.platform import Platform, find_platform, load_platform
from gloc3.record import PLATFORM_FILE, Recorder
from gloc3.topics import TopicTable
from gloc3_onboard.autopilot.link import AutopilotLink
from gloc3_onboard.cameras import NoCamera, StreamCamera
from gloc3_onboard.command_server.site import Site
from gloc3_onboard.requested_path import RequestedPath
from gloc3_onboard.runner import Onboard
from gloc3_onboard.station_link import HeartbeatSource, StationLink
from gloc3_onboard.storage import PictureFolder, RecordFile

MOST_LOGS: Final = 10_000


class ProcessOptions(msgspec.Struct, frozen=True, kw_only=True):
    """What `gloc3 onboard` was asked for."""

    platform: str
    autopilot: str
    stations: tuple[str, ...]
    cameras: tuple[str, ...] = ()
    out: Path | None = None
    system_id: int = 1
    is_quiet: bool = False


async def run(options: ProcessOptions) -> int:
    """Runs until a signal.

    Raises:
        InputError: the platform file is wrong.
        Refused: a link or a camera cannot be had.
    """
    platform = load_platform(options.platform, is_loading_classes=True)
    loop = asyncio.get_running_loop()
    stopped = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stopped.set)
    process = OnboardProcess(options, platform, loop)
    try:
        await process.open()
        await stopped.wait()
        process.say(Severity.NOTICE, "stopping")
    finally:
        await process.close()
    return 0


class OnboardProcess:
    """Everything that one onboard process holds open."""

    def __init__(self, options: ProcessOptions, platform: Platform, loop: asyncio.AbstractEventLoop) -> None:
        self._options, self._platform, self._loop = options, platform, loop
        self._clock = Clock(loop)
        self._topics = TopicTable.installed()
        self._exchange = LocalExchange()
        self._random = SystemRandom()
        self._out = options.out or Path(f"gloc3-{platform.platform}")
        self._endpoints: list[Endpoint] = []
        self._stations: list[StationLink] = []
        self._autopilot = AutopilotLink(loop, self._clock, options.system_id, self.say)
        self._recorder: Recorder | None = None
        self._onboard: Onboard | None = None
        self._path = RequestedPath(self._exchange, platform.platform)
        self._exchange.subscribe(f"{platform.platform}/components/*/event", self._narrate)

    async def open(self) -> None:
        """Opens the log and the links, and brings the components up."""
        platform, options = self._platform, self._options
        self._recorder = self._open_log()
        await self._open_link(options.autopilot, self._autopilot)
        for url in options.stations:
            link = StationLink(
                platform.platform,
                options.system_id,
                self._loop,
                self._exchange,
                self._topics,
                self._random.getrandbits(32),
            )
            self._stations.append(link)
            await self._open_link(url, link)
        HeartbeatSource(
            self._exchange,
            platform.platform,
            lambda: [self._autopilot.send_message, *(station.send for station in self._stations)],
        )
        context = HostContext(platform.platform, self._exchange, self._clock, self._loop, self._topics, self._random)
        self._onboard = Onboard(platform, context, self._devices())
        self._onboard.begin()
        self.say(Severity.INFO, f"{platform.platform}: {len(platform.components)} components; log in {self._out}")

    async def close(self) -> None:
        """Stops the components, then closes what they used."""
        if self._onboard is not None:
            await self._onboard.stop()
            self._onboard.close()
        self._autopilot.close()
        for station in self._stations:
            station.close()
        for endpoint in self._endpoints:
            await endpoint.close()
        if self._recorder is not None:
            self._recorder.write_requested_path(self._path.points_ned_m)
            self._recorder.close()

    def say(self, severity: Severity, text: str) -> None:
        """Narrates on stderr."""
        if not self._options.is_quiet and severity <= Severity.INFO:
            print(f"onboard: {text}", file=sys.stderr, flush=True)  # noqa: T201

    def _narrate(self, envelope: Envelope[Event]) -> None:
        event = envelope.payload
        if event.severity <= Severity.WARNING:
            self.say(event.severity, f"{envelope.source.component}: {event.text}")
            for line in event.details.splitlines():
                self.say(event.severity, f"    {line}")

    def _open_log(self) -> Recorder:
        try:
            self._out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise Refused(f"cannot make the folder {self._out}: {error.strerror}") from error
        names = ["log.mcap", *(f"log-{number}.mcap" for number in range(2, MOST_LOGS))]
        path = next(self._out / name for name in names if not (self._out / name).exists())
        recorder = Recorder(path, self._clock, self._topics, {"platform": self._platform.platform})
        recorder.attach_file(PLATFORM_FILE, "application/yaml", find_platform(self._options.platform).read_bytes())
        recorder.attach(self._exchange, self._loop)
        return recorder

    async def _open_link(self, url: str, link: AutopilotLink | StationLink) -> None:
        endpoint = await open_endpoint(url, self._loop, link.receive)
        self._endpoints.append(endpoint)
        link.open(endpoint)

    def _devices(self) -> dict[str, Any]:
        cameras: dict[str, Any] = {}
        wanted = {device for row in self._platform.components for device in row.devices.values()}
        for text in self._options.cameras:
            name, _, url = text.partition("=")
            if f"{name}_camera" not in wanted:
                raise Refused(f"--camera {text!r}: the platform has no camera {name!r}")
            cameras[f"{name}_camera"] = StreamCamera(url, self._autopilot.t_s_of_boot)
        for device in wanted:
            if device.endswith("_camera"):
                cameras.setdefault(device, NoCamera())
        return {
            **cameras,
            "autopilot": self._autopilot,
            "pictures": PictureFolder(self._out / "images"),
            "site": Site(
                self._platform, RecordFile(self._out / "requests.journal"), RecordFile(self._out / "progress.state")
            ),
        }
