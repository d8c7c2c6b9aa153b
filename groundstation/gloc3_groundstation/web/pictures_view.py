"""The pictures page: the latest picture of a camera, as a picture, over one websocket for each page.

Nothing is requested from a vehicle while no page is open. The vehicle scales pictures down to what the link affords.
"""

import asyncio
from base64 import b64encode
from collections.abc import Callable
from itertools import count
from typing import TYPE_CHECKING, Final

from gloc3.clock import passed
from gloc3.messages.watch import Preview, Want
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.station import wording
from gloc3_groundstation.station.preview_size import RATE_HZ
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.station.watches import Sight
from gloc3_groundstation.web.glass import Glass, parts_of
from gloc3_groundstation.web.page_commands import PageCommands

if TYPE_CHECKING:
    from aiohttp import web

PERIOD_S: Final = 0.5
LEASED_S: Final = 3.0
"""Time for which pictures are requested after the last one that a page has taken, s."""
QUALITY: Final = 60
ROOM: Final = (640, 480)
"""Pixels across and down that a page asks for at most."""
STALE_S: Final = 5.0


class PicturesPage:
    """One browser's pictures.

    Args:
        glass: its websocket.
        viewer: under which the page watches topics.
    """

    def __init__(self, glass: Glass, viewer: str) -> None:
        self.glass: Final = glass
        self.viewer: Final = viewer
        self.selected = ""
        self.camera = ""
        """The topic of the chosen camera; empty for the first."""
        self.room = ROOM
        self.sent: tuple[str, str, float] | None = None
        """Vehicle, topic and reception of the picture that was sent last."""


class PicturesView:
    """Shows pictures to browsers.

    Args:
        desk: knows the vehicles, and commands them.
        in_view: returns the name of the vehicle that the terminal shows; a new page begins with it.
        station: identifies this run of the station.
    """

    def __init__(self, desk: Desk, in_view: Callable[[], str], station: str) -> None:
        self._desk, self._in_view, self._station = desk, in_view, station
        self._commands = PageCommands(desk)
        self._numbers = count(1)

    async def serve(self, socket: "web.WebSocketResponse", who: str, *, may_command: bool) -> None:
        """One browser's pictures, from the opening of its page to its end."""
        loop = asyncio.get_running_loop()
        page = PicturesPage(Glass(socket, loop.time, who, may_command=may_command), f"pictures {next(self._numbers)}")
        page.glass.notify("hello", {"station": self._station, "may_command": may_command})
        feeding = loop.create_task(self._feed(page))
        try:
            await page.glass.converse(lambda data: self.receive(page, data), lambda: None)
        finally:
            feeding.cancel()
            self._desk.station.monitor.unwatch(page.viewer)

    def receive(self, page: PicturesPage, data: str) -> None:
        """Handles a message of the page; unknown ones are ignored."""
        match parts_of(data):
            case ["select", str(name)]:
                page.selected, page.camera = name, ""
                self.show(page)
            case ["camera", str(topic)]:
                page.camera = topic
                self.show(page)
            case ["room", int(width), int(height)]:
                page.room = max(1, min(ROOM[0], width)), max(1, min(ROOM[1], height))
            case ["hold", str(name), beat_ms]:
                self._commands.hold(page.glass, name, beat_ms)

    def show(self, page: PicturesPage) -> None:
        """Requests the picture, and sends what has changed; to a page that takes nothing, nothing."""
        if page.glass.is_busy:
            return
        station = self._desk.station
        fleet, now_s = station.fleet, station.now_s()
        platform = fleet.get(page.selected) or fleet.get(self._in_view()) or next(iter(fleet), None)
        cameras = self._cameras(platform)
        camera = page.camera if page.camera in cameras else next(iter(cameras), "")
        name = platform.name if platform is not None else ""
        sight = self._watched(page, name, camera) if camera else None
        if not camera:
            station.monitor.unwatch(page.viewer)
        page.glass.notify(
            "cameras",
            {
                "vehicles": [one.name for one in fleet],
                "selected": name,
                "cameras": cameras,
                "camera": camera,
                "problem": self._problem(platform, cameras, sight, now_s),
                "age_s": round(now_s - sight.received_s, 1)
                if sight is not None and sight.envelope is not None
                else None,
            },
        )
        if sight is not None:
            self._send(page, name, sight)

    async def _feed(self, page: PicturesPage) -> None:
        while True:
            self.show(page)
            await passed(PERIOD_S)

    def _cameras(self, platform: PlatformSnapshot | None) -> list[str]:
        """The topics of pictures of a vehicle; they are requested where they are not known."""
        monitor = self._desk.station.monitor
        if platform is None or not platform.has_companion:
            return []
        monitor.list_topics(platform.name)
        return [entry.name for entry in monitor.watches.entries(platform.name) if entry.type == "Image"]

    def _watched(self, page: PicturesPage, platform: str, camera: str) -> Sight:
        """Requests a camera's pictures, and returns what has come."""
        monitor, now_s = self._desk.station.monitor, self._desk.station.now_s()
        width, height = monitor.watches.preview_size(platform, camera, page.room)
        monitor.unwatch(page.viewer, except_from=platform)
        monitor.watch(page.viewer, platform, [Want(camera, RATE_HZ, width, height, QUALITY)], for_s=LEASED_S)
        return monitor.watches.sight(platform, camera, now_s)

    def _problem(self, platform: PlatformSnapshot | None, cameras: list[str], sight: Sight | None, now_s: float) -> str:
        """Why there is no new picture; empty where there is one."""
        if platform is None:
            return "no vehicle is heard"
        if not platform.has_companion:
            return wording.bare(platform)
        if sight is None:
            listed = self._desk.station.monitor.watches.entries(platform.name)
            return "it has no camera" if listed and not cameras else "waiting for the list of its cameras"
        if sight.problem:
            return sight.problem
        preview = sight.envelope.payload if sight.envelope is not None else None
        if not isinstance(preview, Preview):
            return "waiting for the first picture"
        if now_s - sight.received_s > STALE_S:
            return f"this picture came {wording.duration(now_s - sight.received_s)} ago"
        return "" if preview.is_valid else preview.reason or "the picture is not valid"

    @staticmethod
    def _send(page: PicturesPage, platform: str, sight: Sight) -> None:
        preview = sight.envelope.payload if sight.envelope is not None else None
        sent = platform, sight.topic, sight.received_s
        if not isinstance(preview, Preview) or not preview.data or sent == page.sent:
            return
        page.sent = sent
        text = f"{preview.width} × {preview.height} of {preview.full_width} × {preview.full_height}"
        page.glass.notify("picture", platform, sight.topic, text, b64encode(preview.data).decode())
