"""What the terminal looks like, compared with pictures that were looked at.

After a change that is meant, `python -m tests.groundstation.tui.test_station_pictures` makes them anew: look at them.
"""

import asyncio
import re
from pathlib import Path

import pytest
from tests.groundstation.flown import FLOWN, Flight
from tests.groundstation.station_scene import Scene, scene

from gloc3_groundstation.store.configuration import Configuration, LastSession, ThemeName

GOLDEN = Path(__file__).parents[1] / "golden"
PICTURES: dict[str, tuple[tuple[int, int], ThemeName, str, list[str]]] = {
    "overview": ((80, 24), "dark", "overview", []),
    "health": ((120, 40), "daylight", "health", ["down"]),
    "mission": ((80, 24), "dark", "mission", ["down", "right", "down"]),
    "map": ((120, 40), "dark", "map", []),
    "help": ((80, 24), "mono", "mission", ["question_mark"]),
}
"""Name to size, theme, screen, and the keys that are pressed."""


async def picture(size: tuple[int, int], theme: ThemeName, screen: str, keys: list[str]) -> str:
    """The terminal as SVG, in trouble in flight, at a time that stands still."""
    configuration = Configuration(theme=theme, session=LastSession(screen=screen))
    async with scene(size=size, configuration=configuration) as here:
        now_s = here.station.started_s + 754.5
        here.station.now_s = lambda: now_s  # type: ignore[misc]
        here.platform.speak()
        await here.wait(lambda: any("read back" in event.text for event in here.station.fleet.events))
        await here.trouble_in_flight()
        if screen in FLOWN:
            flight = Flight(here)
            flight.begin()
            flight.fly(54.25)
        await here.press(*keys)
        return await settled(here)


async def settled(here: Scene) -> str:
    """The picture, once it no longer changes."""
    seen = ""
    for _ in range(100):
        here.app.show_fleet()
        await here.pilot.pause(0.15)
        now = plain(here.app.export_screenshot())
        if now == seen:
            break
        seen = now
    return seen


def plain(svg: str) -> str:
    """The picture without fonts to be fetched, and without the line of screens, which changes with every new one."""
    svg = re.sub(r"@font-face \{.*?\}\s*(?=@|\.)", "", svg, flags=re.DOTALL)
    svg = re.sub(r"terminal-\d+", "terminal", svg)
    svg = re.sub(r'<rect [^>]*y="25\.9"[^>]*/>', "", svg)
    return re.sub(r'<text [^>]*url\(#terminal-line-1\)">[^<]*</text>', "", svg) + "\n"


@pytest.mark.sockets
@pytest.mark.parametrize("name", list(PICTURES))
async def test_the_terminal_looks_as_it_did_when_it_was_looked_at(name: str, tmp_path: Path) -> None:
    now = await picture(*PICTURES[name])
    (tmp_path / f"{name}.svg").write_text(now)
    assert now == (GOLDEN / f"{name}.svg").read_text(), f"look at {tmp_path / name}.svg"


if __name__ == "__main__":
    for each, how in PICTURES.items():
        (GOLDEN / f"{each}.svg").write_text(asyncio.run(picture(*how)))
