"""A station's terminal with a scripted platform: what Pilot tests and screenshots have in common."""

import asyncio
import re
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, NamedTuple

from textual.pilot import Pilot
from textual.screen import Screen
from textual.widgets import Input

from gloc3.errors import Refused
from gloc3.exchange import LocalExchange
from gloc3.messages.envelope import Severity
from gloc3.messages.summaries import MissionSummary
from gloc3.mission.model.model import digest_of
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.desk.flights import End
from gloc3_groundstation.links.link_snapshot import LinkSnapshot
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.station.station import Station
from gloc3_groundstation.store.configuration import Configuration
from gloc3_groundstation.tui.app import Opening, StationApp
from gloc3_groundstation.tui.screen import SMALLEST
from gloc3_groundstation.tui.screens.table import SCREENS
from gloc3_groundstation.tui.widgets.lines import text_of
from gloc3_groundstation.tui.widgets.panel import Panel

from .scripted_platform import TASKS, ScriptedPlatform

TEXT = """mission: cargo hold
frame: hold
on_failure: land
tasks:
  depart: {actions: {climb: {take_off: {height_m: 1.5}}}}
  sweep:
    after: [depart]
    actions:
      wall: {follow_waypoints: {waypoints_m: [[2, 1, 2], [12, 1, 2], [12, 5, 3]], speed_m_s: 0.5}}
      photos: {record_images: {camera: ground, every_m: 0.5}, until: wall}
  recover:
    after: [sweep]
    actions:
      home: {return_home: {}}
      down: {land: {}, after: [home]}
"""
PLAN = CheckedPlan(name="hold.yaml", title="cargo hold", text=TEXT)


TIMEOUT_S = 60.0
"""So long it is waited for what is to be seen, on a machine that is busy."""


class ScriptedLinks:
    """Links that are only told of: opened and closed by name."""

    def __init__(self, *links: LinkSnapshot) -> None:
        self.open = list(links)

    def snapshots(self, platforms: Iterable[str]) -> tuple[LinkSnapshot, ...]:
        return tuple(self.open)

    async def add(self, url: str) -> None:
        if "://" not in url:
            raise Refused(f"endpoint {url!r} has no scheme")
        self.open.append(LinkSnapshot(url=url, is_connected=False))

    async def forward(self, url: str, *, is_both: bool) -> None:
        self.open.append(LinkSnapshot(url=url, is_connected=True, forwards="both ways" if is_both else "one way"))

    async def remove(self, url: str) -> None:
        self.open = [link for link in self.open if link.url != url]


LINKS = (
    LinkSnapshot(
        url="udpin://0.0.0.0:14550",
        is_connected=True,
        bytes_in_s=18_400.0,
        bytes_out_s=640.0,
        frames_in=120_311,
        frames_out=4_012,
        received=("autopilot 1/1", "system 1/191"),
        platforms=("heron",),
    ),
    LinkSnapshot(
        url="serial:///dev/ttyUSB0:57600",
        is_connected=True,
        bytes_in_s=3_120.0,
        bytes_out_s=210.0,
        frames_in=9_120,
        frames_out=801,
        dropped=3,
        received=("system 2/191",),
        platforms=("egret",),
    ),
    LinkSnapshot(url="tcpout://10.0.0.7:5760", is_connected=False, problem="10.0.0.7:5760: connection refused"),
)


class Scene(NamedTuple):
    app: StationApp
    pilot: Pilot[End | None]
    platform: ScriptedPlatform
    station: Station
    exchange: LocalExchange

    def shown(self, panel: str) -> str:
        """The text of a panel of the screen that is shown (also below a dialogue)."""
        self.app.show_fleet()
        panels = self.app.base.query(f"#{panel}").results(Panel) if self.app.base is not None else ()
        return "\n".join(text_of(line) for each in panels for line in each.lines)

    async def until(self, panel: str, text: str) -> None:
        """Waits until a panel shows a text."""
        try:
            await self.wait(lambda: text in self.shown(panel))
        except AssertionError:
            raise AssertionError(f"{panel} never showed {text!r}:\n{self.shown(panel)}") from None

    async def wait(self, is_so: Callable[[], bool]) -> None:
        """Waits until something is so."""
        loop = asyncio.get_running_loop()
        end_s = loop.time() + TIMEOUT_S
        while loop.time() < end_s:
            if is_so():
                return
            await self.pilot.pause(0.003)
        raise AssertionError("it never came to that")

    async def shows(self, kind: type[Screen[Any]]) -> None:
        """Waits for a screen or a dialogue, its widgets included."""
        await self.wait(lambda: isinstance(self.app.screen, kind) and self.app.screen.is_mounted)

    async def press(self, *keys: str) -> None:
        """Presses keys without waiting for the processor to be idle, as `Pilot.press` does."""
        for key in keys:
            self.app.simulate_key(key)
            await self.pilot.pause(0.005)

    async def field(self) -> Input:
        """Waits until a line takes what is typed."""
        await self.wait(lambda: isinstance(self.app.focused, Input))
        assert isinstance(self.app.focused, Input)
        return self.app.focused

    async def types(self, text: str) -> None:
        """Types a text once a line takes it, and waits until it stands there."""
        field = await self.field()
        for letter in text:
            self.app.simulate_key("slash" if letter == "/" else letter)
        await self.wait(lambda: field.value.endswith(text))

    async def enter(self) -> None:
        """Presses enter in a line that is typed into, and waits until keys go elsewhere."""
        await self.field()
        await self.press("enter")
        await self.wait(lambda: not isinstance(self.app.focused, Input))

    async def still(self, panel: str) -> None:
        """Waits until a panel shows the same twice running."""
        seen: list[str] = []

        def is_still() -> bool:
            seen.append(self.shown(panel))
            return len(seen) > 1 and seen[-1] == seen[-2]

        await self.wait(is_still)

    async def go(self, digit: str) -> None:
        """Shows the screen of a digit."""
        row = next(row for row in SCREENS if digit in (row.key, f"f{row.key}"))
        self.app.simulate_key(digit)
        await self.wait(lambda: self.app.current_mode == row.name)
        await self.wait(lambda: self.is_shown(row.name))

    def is_shown(self, name: str) -> bool:
        """Whether a screen is there and has been filled."""
        base = self.app.base
        return (
            base is not None
            and base.row.name == name
            and any(panel.lines for panel in base.query("#tabs").results(Panel))
        )

    def requested(self, kind: type) -> list[object]:
        """The requests of a kind that the platform has had."""
        return [body for body in self.platform.requests if isinstance(body, kind)]

    async def trouble_in_flight(self) -> None:
        """Has the platform fly a mission, with a component that has failed, a gust and a battery that gets low."""
        self.platform.fly(is_armed=True, mode="OFFBOARD", landed="in_air", position_m=(4.2, 1.0, 2.0), speed_m_s=0.5)
        self.platform.mission = MissionSummary(name="cargo hold", digest=digest_of(TEXT), state="running", tasks=TASKS)
        done = dict.fromkeys(("depart", "depart__climb"), "done")
        running = dict.fromkeys(("sweep", "sweep__wall", "sweep__photos"), "running")
        self.platform.advance("running", {"sweep.wall": 0.42}, **done, **running)
        self.platform.event("gust of 7 m/s: setpoint clamped to the limit of 3.0 m/s", Severity.NOTICE, "limiter")
        self.platform.event("battery below 30 %: on_low_battery is return", Severity.WARNING, "command_server")
        self.platform.problem("ground_camera", "ValueError: no frame for 1.0 s, the device has gone away")
        self.platform.speak()
        self.platform.event("working -> faulty: no frame for 1.0 s", Severity.ERROR, "ground_camera")
        self.platform.fly(battery_percent=14)
        await self.pilot.pause()
        self.app.show_fleet()
        await self.pilot.pause()


@asynccontextmanager
async def scene(
    plan: CheckedPlan | None = PLAN,
    size: tuple[int, int] = (80, 24),
    configuration: Configuration = Configuration(),  # noqa: B008 - immutable
    *,
    flies: bool = False,
    links: ScriptedLinks | None = None,
    **options: Any,
) -> AsyncIterator[Scene]:
    """The terminal, with a platform that has not yet said anything."""
    exchange = LocalExchange()
    platform = ScriptedPlatform(exchange)
    platform.delay_s = 0.001
    station = Station(exchange, platform.loop, "255", 11)
    app = StationApp(
        Desk(station, plan, links=links),
        configuration,
        Opening(is_starting=flies, is_closing=flies, **options),
        waiting_for=lambda: "udpin://0.0.0.0:14550",
    )
    async with app.run_test(size=size) as pilot:
        here = Scene(app, pilot, platform, station, exchange)
        await here.wait(lambda: here.is_shown(app.current_mode) or app.size.width < SMALLEST[0])
        try:
            yield here
        finally:
            platform.is_deaf = True
            station.close()


def _placed(text: re.Match[str]) -> str:
    """A text with each sign at its own place, as in a terminal; braille and dingbats in fonts that have them."""
    x, length = (float(re.search(f'{name}="([0-9.]+)"', text[1])[1]) for name in (" x", "textLength"))  # type: ignore[index]
    signs = re.findall("&[^;]+;|.", text[2])
    rest = re.sub(r' (x|textLength)="[0-9.]+"', "", f" {text[1]}")
    places = [f"{x + length * number / len(signs):.2f}" for number in range(len(signs))]
    plain = [(sign, place) for sign, place in zip(signs, places, strict=True) if not "\u2700" <= sign <= "\u28ff"]
    found = [f'<text{rest} x="{" ".join(place for _, place in plain)}">{"".join(sign for sign, _ in plain)}</text>']
    for sign, place in zip(signs, places, strict=True):
        if "\u2700" <= sign <= "\u28ff":
            font = "DejaVu Sans" if sign >= "\u2800" else "DejaVu Sans Mono; font-style:normal"
            found.append(f'<text{rest} x="{place}" style="font-family:{font}">{sign}</text>')
    return "".join(found)


def shoot(app: StationApp, path: Path, scale: float = 1.2) -> None:
    """Writes what the terminal shows as PNG; as SVG where the library cairo is not installed."""
    svg = app.export_screenshot()
    try:
        import cairosvg  # type: ignore[import-untyped]
    except OSError:
        path.with_suffix(".svg").write_text(svg)
        return
    svg = re.sub(r"@font-face \{.*?\}\s*(?=@|\.)", "", svg, flags=re.DOTALL)
    svg = svg.replace("Fira Code, monospace", "DejaVu Sans Mono").replace("Fira Code", "DejaVu Sans Mono")
    svg = re.sub(r"<text ([^>]*textLength[^>]*)>([^<]*)</text>", _placed, svg)
    cairosvg.svg2png(bytestring=svg.encode(), write_to=str(path.with_suffix(".png")), scale=scale)
