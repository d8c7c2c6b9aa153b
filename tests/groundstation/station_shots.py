"""Pictures of every screen in every size, to be looked at: `python -m tests.groundstation.station_shots OUT [SCREEN…]`."""

import asyncio
import sys
from pathlib import Path
from typing import get_args

from gloc3.ci import ControlState
from gloc3_groundstation.configuration import Configuration, ThemeName
from gloc3_groundstation.tui.list_panel import ListPanel
from gloc3_groundstation.tui.screens.table import SCREENS

from .flown import FLOWN, Flight
from .looked_at import Viewer
from .scripted_platform import CHECKS, CLOCK, LINK_LOSS, ScriptedPlatform
from .station_scene import LINKS, Scene, ScriptedLinks, scene, shoot

SIZES = ((80, 24), (120, 40), (200, 60))


async def shots(out: Path, size: tuple[int, int], screens: list[str], theme: ThemeName = "dark") -> None:
    """One size: each screen in trouble in flight, and the dialogues over the overview."""
    tag = f"{size[0]}x{size[1]}" + (f"_{theme}" if theme != "dark" else "")
    async with scene(size=size, configuration=Configuration(theme=theme), links=ScriptedLinks(*LINKS)) as here:
        if not screens:
            shoot(here.app, out / f"{tag}_waiting")
        here.platform.speak()
        await here.until("title", "HOLD")
        await here.pilot.pause(0.1)
        await here.trouble_in_flight()
        viewer = Viewer(here.exchange, here.platform)
        for row in SCREENS:
            if not screens or row.name in screens:
                if row.name in FLOWN:
                    flight = Flight(here)
                    flight.begin()
                    flight.fly(54.25)
                if row.name == "preflight":
                    here.platform.checks = [*CHECKS[:3], LINK_LOSS, *CHECKS[4:], CLOCK]
                await here.go(row.key)
                if row.name == "preflight":
                    await here.until("checks", "NAV_DLL_ACT")
                if row.name == "fleet":
                    await _several(here)
                if row.name == "sensors":
                    await shoot_sensors(here, viewer, out / f"{tag}_picture")
                here.app.look()
                await here.pilot.pause()
                shoot(here.app, out / f"{tag}_{row.name}")
        if screens:
            return
        await here.go("1")
        for name, key in (("help", "question_mark"), ("palette", "ctrl+p"), ("abort", "a")):
            await here.pilot.press(key)
            await here.pilot.pause(0.3)
            shoot(here.app, out / f"{tag}_{name}")
            await here.pilot.press("escape")
        here.app.desk.station.now_s = lambda: here.platform.loop.time() + 12  # type: ignore[misc]
        here.app.look()
        await here.pilot.pause()
        shoot(here.app, out / f"{tag}_stale")


async def _several(here: Scene) -> None:
    """Two more vehicles, of which one is marked, and another station that asks for control."""
    for number, name in enumerate(("egret", "stork")):
        other = ScriptedPlatform(here.exchange, name, 20 + number)
        other.control = ControlState(holder="254")
        other.speak()
    here.platform.control = ControlState(holder="255", requested_by="254")
    here.platform.say("control", here.platform.control)
    await here.press("m")


async def shoot_sensors(here: Scene, viewer: Viewer, picture: Path) -> None:
    """Looks at a camera, of which there is a picture of its own, then at a pose."""
    await here.until("topics", "pose")
    for topic in ("camera/ground", "pose"):
        here.app.screen.query_one("#topics", ListPanel).point_at(topic)
        await here.wait(lambda topic=topic: topic in [want.topic for want in here.platform.watched.wants])  # type: ignore[misc]
        viewer.tell_activity()
        viewer.fly(30.0)
        await here.pilot.pause(0.5)
        here.app.look()
        await here.pilot.pause()
        if topic == "camera/ground":
            shoot(here.app, picture)
    here.app.screen.query_one("#fields", ListPanel).point_at("position_ned_m")


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    themes = [name for name in get_args(ThemeName) if f"--theme={name}" in sys.argv] or ["dark"]
    for each in SIZES:
        for chosen in themes:
            asyncio.run(shots(folder, each, [name for name in sys.argv[2:] if not name.startswith("--")], chosen))
