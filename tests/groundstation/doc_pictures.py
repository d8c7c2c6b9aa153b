"""The pictures in the docs and the README: `python -m tests.groundstation.doc_pictures` makes them anew; look at them."""

import asyncio
import re
from pathlib import Path
from typing import NamedTuple

from gloc3.exchange import Publisher
from gloc3.exchange.acoustic import AcousticSummary
from gloc3.messages.summaries import Health, MissionSummary
from gloc3.mission.model.model import digest_of
from gloc3_groundstation.store.configuration import Configuration, LastSession, ThemeName

from .flown import FLOWN, Flight
from .scripted_platform import CHECKS, CLOCK, LINK_LOSS, TASKS
from .station_scene import TEXT, Scene, scene

FOLDER = Path(__file__).parents[2] / "docs" / "pictures"


class Picture(NamedTuple):
    """One of them."""

    screen: str
    size: tuple[int, int]
    theme: ThemeName = "dark"
    keys: tuple[str, ...] = ()
    """Pressed before it is taken."""
    is_silent: bool = False
    """The vehicle has been out of contact for a while, as planned."""


PICTURES = {
    "overview": Picture("overview", (100, 28)),
    "health": Picture("health", (100, 30), keys=("down",)),
    "mission": Picture("mission", (100, 26), keys=("down", "right", "down")),
    "map": Picture("map", (110, 34)),
    "checks": Picture("preflight", (100, 24)),
    "silence": Picture("overview", (100, 26), is_silent=True),
    "daylight": Picture("overview", (80, 24), theme="daylight"),
}


async def drawn(picture: Picture) -> str:
    """A picture as SVG, without fonts that would be fetched from elsewhere."""
    configuration = Configuration(theme=picture.theme, session=LastSession(screen=picture.screen))
    async with scene(size=picture.size, configuration=configuration) as here:
        if picture.screen not in FLOWN:  # there the flight has a time of its own
            now_s = here.station.started_s + 754.5
            here.station.now_s = lambda: now_s  # type: ignore[misc]
        here.platform.checks = [*CHECKS[:3], LINK_LOSS, *CHECKS[4:], CLOCK]
        here.platform.speak()
        await here.wait(lambda: any("read back" in event.text for event in here.station.fleet.events))
        if picture.screen in FLOWN:
            flight = Flight(here)
            flight.begin()
            flight.fly(54.25)
        elif picture.screen == "preflight":
            await here.until("checks", "NAV_DLL_ACT")
        elif picture.is_silent:
            await silent(here)
        else:
            await here.trouble_in_flight()
        await here.press(*picture.keys)
        return await settled(here)


async def silent(here: Scene) -> None:
    """Has the vehicle dive out of contact, for five minutes of its twenty; since then it was heard by sound alone."""
    begun_s, loop = here.station.now_s(), here.platform.loop
    here.platform.fly(is_armed=True, mode="GUIDED", landed="in_air", position_m=(4.2, 1.0, -2.1), speed_m_s=0.5)
    here.platform.mission = MissionSummary(
        name="cargo hold",
        digest=digest_of(TEXT),
        state="running",
        tasks=TASKS,
        silence="sweep",
        silent_until_s=loop.time() + 1200.0,
    )
    done, running = (
        dict.fromkeys(("depart", "depart__climb"), "done"),
        dict.fromkeys(("sweep", "sweep__wall"), "running"),
    )
    here.platform.advance("running", {"sweep.wall": 0.12}, **done, **running)
    here.platform.speak()
    await here.until("title", "ARMED")
    by_sound = AcousticSummary(
        t_s=loop.time(),
        position_m=(38.4, 15.1, -5.2),
        heading_deg=90,
        speed_m_s=0.5,
        battery_percent=84,
        state="running",
        health=Health.WORKING,
        is_pose_valid=True,
        is_armed=True,
        policy="",
        doing=list(TASKS).index("sweep.wall"),
        mission=int(digest_of(TEXT)[:2], 16),
        worst=7,
    )
    here.station.now_s = lambda: begun_s + 260.0  # type: ignore[misc]
    Publisher(here.exchange, "heron", "acoustic", 3).publish("heron/acoustic", by_sound, loop.time())
    here.station.now_s = lambda: begun_s + 300.0  # type: ignore[misc]
    await here.until("facts", "silent as planned")


async def settled(here: Scene) -> str:
    """The picture, once it no longer changes."""
    seen = ""
    for _ in range(100):
        here.app.show_fleet()
        await here.pilot.pause(0.15)
        svg = re.sub(r"@font-face \{.*?\}\s*(?=@|\.)", "", here.app.export_screenshot(), flags=re.DOTALL)
        svg = re.sub(r"terminal-\d+", "terminal", svg)
        svg = re.sub(r"<text ([^>]*textLength[^>]*)>([^<]*[\u2800-\u28ff][^<]*)</text>", placed, svg)
        if svg == seen:
            break
        seen = svg
    return seen + "\n"


def placed(text: re.Match[str]) -> str:
    """A text with braille, each sign at its own place: in many fonts braille is wider or narrower than the rest."""
    x, length = (float(re.search(f'{name}="([0-9.]+)"', text[1])[1]) for name in (" x", "textLength"))  # type: ignore[index]
    signs = re.findall("&[^;]+;|.", text[2])
    rest = re.sub(r' (x|textLength)="[0-9.]+"', "", f" {text[1]}")
    places = " ".join(f"{x + length * number / len(signs):.1f}" for number in range(len(signs)))
    return f'<text{rest} x="{places}">{text[2]}</text>'


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, each in PICTURES.items():
        (FOLDER / f"{name}.svg").write_text(asyncio.run(drawn(each)))
