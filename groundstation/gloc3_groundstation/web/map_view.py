"""The map page's data and commands, over one websocket for each page."""

import asyncio
from collections.abc import Callable
from secrets import token_urlsafe
from typing import TYPE_CHECKING, Final, NamedTuple

from gloc3.clock import passed
from gloc3.errors import Refused
from gloc3_groundstation.desk import go_here
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.go_here import GoToRequest
from gloc3_groundstation.mapping.ground import Ground
from gloc3_groundstation.mapping.requested import Requested, requested
from gloc3_groundstation.mapping.tracks import Tracks
from gloc3_groundstation.missions.plans import MissionTexts
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.web import map_commands
from gloc3_groundstation.web.glass import Glass, parts_of
from gloc3_groundstation.web.map_data import MapPlan, TrailFeed, picture_of, plan_of
from gloc3_groundstation.web.page_commands import PageCommands
from gloc3_groundstation.web.tiles import TileInfo

if TYPE_CHECKING:
    from aiohttp import web

PERIOD_S: Final = 0.5
CONFIRMED_S: Final = 60.0
"""Time within which a question has to be answered."""


class MapSource(NamedTuple):
    """What the map is made from."""

    desk: Desk
    """Knows the vehicles, and commands them."""
    tracks: Callable[[], Tracks]
    """Returns where the vehicles have been."""


class MapPage:
    """One browser's map.

    Args:
        glass: its websocket.
        tracks: where the vehicles have been.
    """

    def __init__(self, glass: Glass, tracks: Tracks) -> None:
        self.glass: Final = glass
        self.trails: Final = TrailFeed(tracks)
        self.selected = ""
        self.plan: MapPlan | None = None
        """What was sent last."""
        self.question: tuple[str, GoToRequest, float] | None = None
        """The open one, its name and when it was asked."""


class MapView:
    """Shows maps to browsers, and carries out their commands by the desk."""

    def __init__(self, source: MapSource, in_view: Callable[[], str], station: str, tiles: TileInfo | None) -> None:
        """Creates a view without browsers.

        Args:
            source: the vehicles, and where they have been.
            in_view: name of the vehicle that the terminal shows; a new page begins with it.
            station: identifies this run of the station.
            tiles: what tiles there are; None for none.
        """
        self._desk, self._tracks, self._in_view = source.desk, source.tracks, in_view
        self._station, self._tiles = station, tiles
        self._texts = MissionTexts(source.desk.station)
        self._commands = PageCommands(self._desk)

    async def serve(self, socket: "web.WebSocketResponse", who: str, *, may_command: bool) -> None:
        """One browser's map, from its opening to its end."""
        loop = asyncio.get_running_loop()
        page = MapPage(Glass(socket, loop.time, who, may_command=may_command), self._tracks())
        page.glass.notify("hello", {"station": self._station, "may_command": may_command, "tiles": self._tiles})
        feeding = loop.create_task(self._feed(page))
        try:
            await page.glass.converse(lambda data: self.receive(page, data), lambda: None)
        finally:
            feeding.cancel()

    def receive(self, page: MapPage, data: str) -> None:
        """Handles a message of the page; unknown ones are ignored."""
        glass, now_s = page.glass, self._desk.station.now_s()
        kind, *values = parts_of(data)
        match kind, *values:
            case "select", str(name):
                page.selected = name
                self.show(page)
            case (("go_to" | "confirm"), *_) if not glass.may_command:
                glass.notify("read_only")
            case "hold", str(name), beat_ms:
                self._commands.hold(glass, name, beat_ms)
            case "go_to", str(name), str(key), float() | int() as north, float() | int() as east, beat_ms if (
                glass.is_current(beat_ms)
            ):
                self._put_question(page, name, key, (float(north), float(east)))
            case "confirm", str(name), float() | int() as height, beat_ms if glass.is_current(beat_ms):
                asked, page.question = page.question, None
                if asked is None or asked[0] != name or now_s - asked[2] > CONFIRMED_S:
                    glass.notify("result", False, "the question is not open any more: choose the place again")
                else:
                    self._commands.carry_out(glass, go_here.go_to(self._desk, asked[1], float(height)))

    def show(self, page: MapPage) -> None:
        """Sends what has changed; to a page that takes nothing, nothing."""
        if page.glass.is_busy:
            return
        fleet, now_s = self._desk.station.fleet, self._desk.station.now_s()
        platform = fleet.get(page.selected) or fleet.get(self._in_view()) or next(iter(fleet), None)
        request, is_loaded = self._requested(platform, now_s)
        ground = Ground(platform)
        page.glass.notify("map", picture_of(fleet, platform, ground, now_s))
        plan = plan_of(platform, ground, request, is_loaded=is_loaded)
        if plan != page.plan:
            page.plan = plan
            page.glass.notify("plan", plan)
        trails = page.trails.new(ground, fleet)
        if trails is not None:
            page.glass.notify("trails", trails)

    async def _feed(self, page: MapPage) -> None:
        while True:
            self.show(page)
            await passed(PERIOD_S)

    def _requested(self, platform: PlatformSnapshot | None, now_s: float) -> tuple[Requested | None, bool]:
        text, is_loaded = self._texts.text_of(platform, self._desk.plan)
        if platform is not None and self._texts.missing(platform, now_s):
            self._commands.start(self._texts.fetch(platform))
        site = platform.site.value if platform is not None and platform.site is not None else None
        return (requested(text, site) if text else None), is_loaded

    # --- commands ---

    def _put_question(self, page: MapPage, name: str, key: str, place: tuple[float, float]) -> None:
        page.question = None
        try:
            request = map_commands.asked(self._desk, name, key, *place)
        except Refused as refusal:
            page.glass.notify("result", False, f"{name}: go to: {refusal}")
            return
        number = token_urlsafe(6)
        page.question = number, request, self._desk.station.now_s()
        page.glass.notify(
            "question",
            {
                "number": number,
                "text": request.question,
                "height_m": request.height_m,
                "height_name": request.height_name,
            },
        )
