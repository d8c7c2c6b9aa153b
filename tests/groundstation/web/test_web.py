"""The station in a browser: a real page and a real websocket; who gets in, who has the window, and what outlives it."""

import asyncio
import json
import signal
import socket
import sys
import urllib.request
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from socket import gethostname
from typing import Any, NamedTuple
from urllib.error import HTTPError

import pytest
from tests.commands.programs import program
from tests.groundstation.emulator import Emulator
from tests.groundstation.scripted_platform import ScriptedPlatform
from tests.groundstation.station_scene import PLAN
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import InvalidStatus

from gloc3.errors import Gloc3Error, Refused
from gloc3.exchange import LocalExchange
from gloc3.messages.command_interface import Emergency, Steer
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import ControlState
from gloc3_groundstation.cli import session
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.tui.app import Opening, StationApp
from gloc3_groundstation.web.glass import MOST_WAITING
from gloc3_groundstation.web.map_view import MapSource
from gloc3_groundstation.web.server import WebAddresses, WebOptions, WebServer

pytestmark = pytest.mark.sockets


class Page:
    """What the page does: a terminal at the end of a websocket."""

    def __init__(self, websocket: ClientConnection, columns: int, lines: int) -> None:
        self.websocket = websocket
        self.terminal = Emulator(columns, lines)
        self.messages: list[list[Any]] = []
        """What was not drawn, but for beats."""
        self.beat_ms = -1.0

    async def report(self, *message: object) -> None:
        await self.websocket.send(json.dumps(message))

    async def introduce(self, **fields: object) -> None:
        columns, lines = self.terminal.size
        await self.report("hello", {"width": columns, "height": lines, **fields})
        await self.wait(lambda: self.beat_ms >= 0.0, "a beat")

    async def press(self, text: str) -> None:
        await self.report("stdin", text, self.beat_ms)

    async def until(self, text: str) -> None:
        """Waits until the terminal shows a text."""
        await self.wait(lambda: text in self.terminal.text(), text)

    async def message(self, kind: str) -> list[Any]:
        """Waits for a message of a kind; what came with it."""
        await self.wait(lambda: any(message[0] == kind for message in self.messages), kind)
        found = next(message for message in self.messages if message[0] == kind)
        self.messages.remove(found)
        return found[1:]

    async def wait(self, is_so: Callable[[], bool], what: str) -> None:
        try:
            async with asyncio.timeout(10.0):
                while not is_so():
                    await self.take()
        except TimeoutError:
            raise AssertionError(f"never shown: {what!r}\n{self.terminal.text()}\n{self.messages[-9:]}") from None

    async def take(self) -> None:
        """Takes what comes next."""
        data = await self.websocket.recv()
        if isinstance(data, bytes):
            self.terminal.feed(data)
            return
        message = json.loads(data)
        if message[0] == "beat":
            self.beat_ms = message[1]
        else:
            self.messages.append(message)


class Served(NamedTuple):
    url: str
    addresses: WebAddresses
    warned: list[str]
    app: StationApp
    platform: ScriptedPlatform
    reported: list[str]
    ended: asyncio.Task[Any]
    exchange: LocalExchange

    @asynccontextmanager
    async def page(
        self,
        columns: int = 100,
        lines: int = 30,
        origin: str | None = None,
        cookie: str = "",
        path: str = "ws",
        **hello: object,
    ) -> AsyncIterator[Page]:
        url = f"{self.url.replace('http', 'ws')}{path}"
        headers = {"Cookie": cookie} if origin is None else {"Origin": origin}
        async with connect(url, additional_headers=headers, compression=None, open_timeout=60.0) as websocket:
            page = Page(websocket, columns, lines)
            await page.introduce(**hello)
            yield page


@asynccontextmanager
async def served(options: WebOptions = WebOptions(port=0)) -> AsyncIterator[Served]:  # noqa: B008 - immutable
    """A station with a scripted platform, shown to browsers."""
    exchange = LocalExchange()
    platform = ScriptedPlatform(exchange)
    platform.delay_s = 0.001
    station = Station(exchange, platform.loop, "255", 11)
    app = StationApp(Desk(station, PLAN), opening=Opening(is_in_browser=True))
    source = MapSource(app.desk, lambda: app.tracks)
    reported: list[str] = []
    warned: list[str] = []
    server = WebServer(lambda: app.window, options, lambda text, _: reported.append(text), warned.append, source)
    async with server.serving() as addresses:
        url = (addresses.command or addresses.watch).partition("?")[0].replace(gethostname(), "127.0.0.1")
        ended = asyncio.create_task(app.run_async())
        platform.speak()
        try:
            yield Served(url, addresses, warned, app, platform, reported, ended, exchange)
        finally:
            app.exit()
            await ended
            platform.is_deaf = True
            station.close()


def emergencies(here: Served) -> list[Emergency]:
    return [body for body in here.platform.requests if isinstance(body, Emergency)]


def no_progress(text: str, is_watched: bool) -> None:
    raise AssertionError(text)


def no_warning(text: str) -> None:
    raise AssertionError(text)


async def status_of(url: str, **headers: str) -> int:
    def request() -> int:
        try:
            with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=60.0) as answer:
                return int(answer.status)
        except HTTPError as error:
            return error.code

    return await asyncio.to_thread(request)


async def test_a_browser_sees_the_station_and_its_keys_mouse_and_size_count() -> None:
    async with served() as here, here.page() as page:
        await page.until("heron   HOLD   disarmed")
        await page.press("s")
        await page.until("It arms and starts moving.")
        await page.press("y")
        await page.until("the mission is started")
        assert len([body for body in here.platform.requests if isinstance(body, Steer)]) == 1
        await page.press("\x1bOQ")
        await page.until("the data flows from end to end")
        page.terminal.resize(70, 20)
        await page.report("resize", {"width": 70, "height": 20})
        await page.until("This terminal has 70 × 20 characters.")
        await page.until("The station needs 80 × 24: reload the page")
        await page.press(" ")
        async with asyncio.timeout(5.0):
            while not any(isinstance(body, Emergency) for body in here.platform.requests):
                await asyncio.sleep(0.01)
        page.terminal.resize(120, 40)
        await page.report("resize", {"width": 120, "height": 40})
        await page.press("1")
        await page.until("emergency hold")
        await page.report("ping", "17")
        assert await page.message("pong") == ["17"]


async def test_escape_alone_is_a_key_and_ctrl_c_asks_as_quitting_does() -> None:
    async with served() as here, here.page() as page:
        await page.until("heron")
        here.platform.control = ControlState(holder="255")
        here.platform.fly(is_armed=True)
        here.platform.speak()
        await page.until("in control")
        await page.press("\x03")
        await page.until("y  quit")
        await page.press("\x1b")
        async with asyncio.timeout(5.0):
            while "y  quit" in page.terminal.text():
                await page.take()
        assert not here.ended.done()


async def test_the_station_runs_on_when_its_window_is_closed_and_is_whole_for_the_next() -> None:
    async with served() as here:
        async with here.page() as page:
            await page.until("heron")
            await page.press("2")
            await page.until("the data flows from end to end")
        async with asyncio.timeout(5.0):
            while "has disconnected" not in here.reported[-1]:
                await asyncio.sleep(0.01)
        here.platform.fly(mode="OFFBOARD")
        async with here.page(80, 24) as page:
            await page.until("heron   Offboard")
            await page.until("the data flows from end to end")
            assert here.reported[-1] == "the station is shown to 127.0.0.1"


async def test_a_window_that_comes_again_has_the_terminal_again_and_another_does_not_take_it() -> None:
    async with served() as here, here.page(window="one") as first:
        await first.until("heron")
        async with here.page(window="two") as second, here.page(window="one") as again:
            await second.until("The station is shown in another window.")
            await again.until("heron   HOLD   disarmed")
            await first.until("The station is shown in another window.")
        await first.websocket.close()
        async with here.page(window="two", was_shown=False) as second:
            await second.until("The station is shown in another window.")


async def test_beats_come_while_nothing_changes_and_a_key_that_is_older_than_3_s_does_nothing() -> None:
    async with served() as here, here.page() as page:
        await page.until("heron")
        first_ms = page.beat_ms
        await page.wait(lambda: page.beat_ms >= first_ms + 1000.0, "further beats")
        for beat_ms in (page.beat_ms - 3100.0, page.beat_ms + 1e6, -1.0, "17", None):
            await page.report("stdin", " ", beat_ms)
            (age_s,) = await page.message("dropped")
            assert age_s > 3.0
        await page.report("hold", page.beat_ms - 3100.0)
        await page.message("dropped")
        assert not emergencies(here)
        await page.press("2")
        await page.until("the data flows from end to end")


async def test_hold_holds_while_typing_and_from_a_window_that_does_not_have_the_terminal() -> None:
    async with served() as here, here.page() as first:
        await first.until("heron")
        await first.press("\x10")
        await first.until("Search for commands")
        await first.report("hold", first.beat_ms)
        await first.message("hold")
        async with asyncio.timeout(5.0):
            while not emergencies(here):
                await asyncio.sleep(0.01)
        async with here.page() as second:
            await second.until("The station is shown in another window.")
            await second.report("hold", second.beat_ms)
            await second.until("land here")
            await second.report("hold", second.beat_ms)
            async with asyncio.timeout(5.0):
                while len(emergencies(here)) < 2:
                    await asyncio.sleep(0.01)


async def test_that_nobody_looks_at_an_armed_vehicle_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "narrate", lambda text: None)
    exchange = LocalExchange()
    platform = ScriptedPlatform(exchange)
    station = Station(exchange, platform.loop, "255", 11)
    platform.control = ControlState(holder="255")
    report = session.reporter(Desk(station))
    for is_armed in (False, True):
        platform.fly(is_armed=is_armed)
        platform.speak()
        report("it is shown", True)
        report("it has gone", False)
    reported = [event for event in station.fleet.events if event.text.startswith("it ")]
    assert [event.severity for event in reported] == [Severity.NOTICE] * 3 + [Severity.WARNING]
    assert "heron: armed and controlled by this station" in reported[-1].text
    platform.is_deaf = True
    station.close()


async def test_a_second_window_says_so_and_takes_the_station_over_with_enter() -> None:
    async with served() as here, here.page() as first, here.page() as second:
        await first.until("heron")
        await second.until("The station is shown in another window.")
        await second.press("q s \x03")
        await second.press("\r")
        await second.until("heron   HOLD   disarmed")
        await first.until("The station is shown in another window.")
        assert not [body for body in here.platform.requests if isinstance(body, Steer)], "what came before was not keys"
        await first.press("\r")
        await first.until("heron   HOLD   disarmed")


async def test_q_ends_the_station_and_the_page_is_told() -> None:
    async with served() as here, here.page() as page:
        await page.until("heron")
        await page.press("q")
        await asyncio.wait_for(here.ended, 5.0)


async def test_a_browser_that_takes_nothing_costs_no_memory_and_is_drawn_anew() -> None:
    async with served() as here, here.page() as page:
        await page.until("heron")
        window = here.app.window
        assert window is not None
        for _ in range(40):
            window.write("x" * (MOST_WAITING // 10))
        await page.until("heron   HOLD   disarmed")
        assert page.terminal.received < 2 * MOST_WAITING


async def test_a_browser_that_takes_nothing_does_not_keep_the_station_from_closing() -> None:
    loop = asyncio.get_running_loop()
    async with AsyncExitStack() as stack:
        async with served() as here:
            page = await stack.enter_async_context(here.page())
            await page.until("heron")
            window = here.app.window
            assert window is not None
            for _ in range(100):
                window.write("x" * (MOST_WAITING // 10))
                await asyncio.sleep(0.002)
            begin_s = loop.time()
        assert loop.time() - begin_s < 9.0
        page.websocket.transport.abort()


@pytest.mark.parametrize("name", ["localhost:1", "127.0.0.1", "[::1]:9"])
async def test_it_answers_under_the_names_of_this_computer(name: str) -> None:
    async with served() as here:
        assert await status_of(here.url, Host=name) == 200


async def test_pages_of_other_sites_and_names_pointed_here_get_nothing() -> None:
    async with served() as here:
        assert await status_of(here.url, Host="drones.example") == 403
        assert await status_of(here.url, Origin="https://drones.example") == 403
        for origin in ("http://drones.example", "null"):
            with pytest.raises(InvalidStatus, match="403"):
                async with here.page(origin=origin):
                    pass
        async with here.page(origin=here.url.rstrip("/")) as page:
            await page.until("heron")


async def test_what_cannot_be_understood_is_left_alone() -> None:
    async with served() as here, here.page() as page:
        for data in (
            "",
            "{",
            "[]",
            "{}",
            "[1]",
            '["stdin"]',
            '["stdin", 3]',
            '["resize", {"width": -4, "height": 1e9}]',
        ):
            await page.websocket.send(data)
        await page.websocket.send(b"\x00")
        await page.report("resize", {"width": 10**9, "height": 0})
        await page.report("resize", {"width": 100, "height": 30})
        await page.until("heron   HOLD   disarmed")


async def test_an_address_that_cannot_be_had_is_told_with_what_to_do() -> None:
    with socket.create_server(("127.0.0.1", 0)) as used:
        port = used.getsockname()[1]
        with pytest.raises(Refused, match=f"port {port}: address already in use; another port: --web-port"):
            async with WebServer(lambda: None, WebOptions(port=port), no_progress, no_warning).serving():
                pass
    with pytest.raises(Refused, match=r"on nowhere\.invalid port 0: .*--web-host"):
        async with WebServer(
            lambda: None, WebOptions(host="nowhere.invalid", port=0), no_progress, no_warning
        ).serving():
            pass


async def test_without_the_package_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "textual_serve", None)
    with pytest.raises(Gloc3Error, match=r"--web needs textual-serve: pip install 'gloc3\[groundstation\]'"):
        async with WebServer(lambda: None, WebOptions(), no_progress, no_warning).serving():
            pass


async def test_the_program_serves_and_ctrl_c_ends_it_while_a_browser_looks(tmp_path: Path) -> None:
    options = ("--link", "udpin://127.0.0.1:0", "--no-record", "--config", "station.toml")
    with program("station", "--web", "--web-port", "0", *options, folder=tmp_path) as station:
        line = await asyncio.to_thread(station.await_line, lambda line: "the station is at" in line)
        url = line.split()[4]
        assert url.startswith("http://127.0.0.1:"), "nobody else is served unless that is asked for"
        assert await status_of(url) == 200
        assert await status_of(f"{url}static/js/textual.js") == 200
        async with connect(f"{url.replace('http', 'ws')}ws") as websocket:
            page = Page(websocket, 90, 30)
            await page.introduce()
            await page.until("Waiting for a platform")
            station.interrupt()
            await asyncio.wait_for(websocket.wait_closed(), 10.0)
            assert websocket.close_reason == "the station was closed"
        assert await asyncio.to_thread(station.end) == 128 + signal.SIGINT
        assert station.lines[-1].endswith("stopped")
        assert not any("Traceback" in line for line in station.lines)
