"""Pictures of the station in the docs: its terminal on real flights in virtual time, which look the same every time."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from tests.pictures.animation import Animation
from textual.pilot import Pilot

from gloc3.clock import run_virtual
from gloc3_groundstation.desk import flights
from gloc3_groundstation.missions.plans import CheckedPlan, read_plan
from gloc3_groundstation.store.configuration import Configuration, LastSession, ThemeName
from gloc3_groundstation.tui.app import StationApp
from gloc3_sitl.faults.faults import schedule_faults
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan

MISSION = "inspection"
SURVEY = Path(__file__).parents[1] / "evidence" / "store.yaml"
"""Out of contact for 25 minutes."""
RADIO_DEPTH_M = 0.3
SHOT_S = 0.4
"""For which a screenshot of the animation is shown."""
NOTICED_S = 0.5
"""Of the flight, until a key has had its effect."""


class Terminal:
    """The terminal of a flight's station, and what is pressed on it."""

    def __init__(self, flight: Flight, app: StationApp, pilot: Pilot[Any]) -> None:
        self.flight, self.app, self.pilot = flight, app, pilot

    async def press(self, *keys: str) -> None:
        """Presses keys one by one."""
        for key in keys:
            self.app.simulate_key(key)
            await asyncio.sleep(NOTICED_S)

    async def until(self, t_s: float) -> None:
        """Waits for a time of the flight."""
        await asyncio.sleep(t_s - self.flight.loop.time())

    async def picture(self, title: str, size: tuple[int, int], *keys: str) -> str:
        """What is shown at a size after some keys."""
        await self.pilot.resize_terminal(*size)
        await self.press(*keys)
        return still(title, self.app.export_screenshot())


def still(title: str, screenshot: str) -> str:
    """A single screenshot."""
    found = Animation(title)
    found.add(screenshot, 1.0)
    return found.svg()


@contextmanager
def virtual_timers() -> Iterator[None]:
    """Textual's timers by the running loop's clock, and not by the wall's."""
    with patch("textual._time.get_time", asyncio.get_running_loop().time):
        yield


@asynccontextmanager
async def terminal(
    flight: Flight, size: tuple[int, int], plan: CheckedPlan | None = None, theme: ThemeName = "dark"
) -> AsyncIterator[Terminal]:
    """A terminal on the flight's station, to which a plan, if there is one, has been uploaded."""
    configuration = Configuration(theme=theme, session=LastSession(screen="overview"))
    with virtual_timers():
        app = StationApp(flight.ground.desk(plan), configuration)
        async with app.run_test(size=size) as pilot:
            while app.platform is None or not (plan is None or _is_read_back(flight)):
                await asyncio.sleep(0.1)
            yield Terminal(flight, app, pilot)


def _is_read_back(flight: Flight) -> bool:
    return any("read back" in event.text for event in flight.station.fleet.events)


async def demo() -> str:
    """Twenty seconds of an inspection by keys: upload, start, map, a component that crashes, a pause, and home."""
    movie = Animation("An inspection in a cargo hold at the ground station in a terminal")
    async with Flight(FlightPlan(mission=MISSION)) as flight, terminal(flight, (100, 28)) as here:

        async def play(shots: int, each_s: float, *keys: str) -> None:
            await here.press(*keys)
            for _ in range(shots):
                movie.add(here.app.export_screenshot(), SHOT_S)
                await asyncio.sleep(each_s)

        await here.until(6.0)
        await play(3, 1.0)
        await play(1, 0.5, "3")
        await play(2, 0.5, "o", *MISSION)
        await play(2, 0.5, "enter")
        await play(2, 1.0, "u")
        await play(2, 0.5, "s")
        await play(4, 2.0, "y")
        await play(14, 3.0, "4", "o")
        schedule_faults(flight, ("crash:limiter",))
        await play(5, 0.4, "2")
        await play(3, 1.0, "3", "p")
        await play(2, 1.0, "r")
        await play(7, 6.0, "4")
        await play(2, 2.0, "1")
    return movie.svg()


async def in_flight() -> dict[str, str]:
    """The screens during an inspection; in its middle the camera breaks, and then the battery runs low."""
    found = {}
    async with Flight(FlightPlan(mission=MISSION)) as flight:
        plan = read_plan(MISSION, flight.name)
        async with terminal(flight, (110, 34), plan) as here:
            await flights.await_ready(flight.station, flight.name)
            await here.press("s", "y")
            await here.until(38.0)
            found["mission"] = await here.picture("Mission", (100, 26), "3", "down", "right", "down")
            await here.until(60.0)
            found["map"] = await here.picture("Map", (110, 34), "4", "o")
            schedule_faults(flight, ("crash:ground_camera@62..", "battery=0.22@64"))
            await here.until(66.0)
            found["overview"] = await here.picture("Overview", (100, 28), "1")
            found["health"] = await here.picture("Health", (100, 30), "2", *["down"] * 4)
        async with terminal(flight, (80, 24), theme="daylight") as here:
            await asyncio.sleep(2.0)
            found["daylight"] = await here.picture("Overview by daylight", (80, 24))
    return found


async def before_flight() -> dict[str, str]:
    """The pre-flight list of a vehicle with a setting that the mission does not suit."""
    plan = FlightPlan(mission=MISSION, parameters={"NAV_DLL_ACT": 2.0, "COM_DL_LOSS_T": 10.0})
    async with Flight(plan) as flight, terminal(flight, (100, 24), read_plan(MISSION, flight.name)) as here:
        await here.until(12.0)
        await here.press("8")
        await asyncio.sleep(5.0)
        return {"checks": await here.picture("Pre-flight checks", (100, 24))}


async def out_of_contact() -> dict[str, str]:
    """An AUV on a survey that nobody hears, but for its modem."""
    plan = FlightPlan(
        mission=str(SURVEY), platform="auv", world="bay", radio_depth_m=RADIO_DEPTH_M, modem_period_s=30.0
    )
    async with Flight(plan) as flight, terminal(flight, (100, 26), read_plan(plan.mission, flight.name)) as here:
        await here.press("s", "y")
        await here.until(325.0)
        return {"silence": await here.picture("Overview of a vehicle out of contact", (100, 26))}


def demo_picture(folder: Path, scratch: Path) -> None:
    """The animated picture of the README."""
    (folder / "demo.svg").write_text(run_virtual(demo()), encoding="utf-8")


def flight_pictures(folder: Path, scratch: Path) -> None:
    """The screens in flight."""
    _keep(folder, run_virtual(in_flight()))


def checks_picture(folder: Path, scratch: Path) -> None:
    """The screen before a flight."""
    _keep(folder, run_virtual(before_flight()))


def silence_picture(folder: Path, scratch: Path) -> None:
    """The overview of a vehicle out of contact."""
    _keep(folder, run_virtual(out_of_contact()))


def _keep(folder: Path, pictures: dict[str, str]) -> None:
    for name, svg in pictures.items():
        (folder / f"{name}.svg").write_text(svg, encoding="utf-8")
