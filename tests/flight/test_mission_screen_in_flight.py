"""An operator's whole journey at the mission screen, with the real stack behind it: open, mend, stream, fly, steer, abort.

The terminal needs a loop that really waits; its clock goes faster than the wall's.
"""

import asyncio
import selectors
from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Input

from gloc3.messages.summaries import MissionSummary
from gloc3_groundstation.desk.desk import Desk
from gloc3_groundstation.tui.app import StationApp
from gloc3_groundstation.tui.dialogues.mission_files import OpenMission
from gloc3_groundstation.tui.dialogues.questions import YesNoQuestion
from gloc3_groundstation.tui.dialogues.single_action import SingleAction
from gloc3_groundstation.tui.screens.mission import MissionScreen
from gloc3_groundstation.tui.widgets.lines import text_of
from gloc3_groundstation.tui.widgets.mission_text import MissionEditor
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel
from gloc3_sitl.flight.flight import Flight
from gloc3_sitl.flight.plan import FlightPlan

pytestmark = pytest.mark.flight

FASTER = 10.0
WITHIN_S = 120.0
"""Of the flight's time, for each step."""
MISSION = """mission: journey
frame: hold
on_failure: land
on_low_battery: return
tasks:
  depart:
    actions:
      climb: {take_off: {height_m: 1.5}}
  sweep:
    after: [depart]
    actions:
      out: {follow_waypoints: {waypoints_m: [[8, 0, 1.5]], speed_m_s: 0.5}}
      side: {follow_waypoints: {waypoints_m: [[8, 6, 1.5]], speed_m_s: slow}, after: [out]}
  recover:
    after: [sweep]
    actions:
      home: {return_home: {}}
      down: {land: {}, after: [home]}
"""


class PatientSelector(selectors.DefaultSelector):
    """Waits a shorter time than it is told, and counts what it was told: what is computed takes no time."""

    now_s = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None or timeout <= 0.0:
            return super().select(timeout)
        began_s = monotonic()
        ready = super().select(timeout / FASTER)
        self.now_s += min(timeout, (monotonic() - began_s) * FASTER) if ready else timeout
        return ready


class PatientLoop(asyncio.SelectorEventLoop):
    """A loop whose clock goes faster than the wall's, and stands while something is computed."""

    def __init__(self) -> None:
        self._waits = PatientSelector()
        super().__init__(self._waits)

    def time(self) -> float:
        return self._waits.now_s


class Operator:
    """Presses keys and reads the screen."""

    def __init__(self, app: StationApp, pilot: Pilot[Any], name: str) -> None:
        self.app, self.pilot, self.name = app, pilot, name

    @property
    def reported(self) -> MissionSummary:
        platform = self.app.desk.station.fleet.get(self.name)
        assert platform is not None
        assert platform.mission is not None
        return platform.mission.value

    def shown(self, panel: str) -> str:
        found = [*self.app.screen.query(f"#{panel}").results(Panel)]
        return "\n".join(text_of(line) for each in found for line in each.lines)

    async def wait(self, is_so: Callable[[], bool], what: str) -> None:
        try:
            async with asyncio.timeout(WITHIN_S):
                while not is_so():
                    await asyncio.sleep(0.1)
        except TimeoutError:
            events = "\n".join(event.text for event in self.app.desk.station.fleet.events[-12:])
            raise AssertionError(f"never {what}\n{self.shown('graph')}\n{events}") from None

    async def see(self, panel: str, text: str) -> None:
        await self.wait(lambda: text in self.shown(panel), f"{panel}: {text}")

    async def state(self, target: str, *states: str) -> None:
        def is_so() -> bool:
            return (self.reported.tasks.get(target) if target else self.reported.state) in states

        await self.wait(is_so, f"{target or 'mission'} {states}")

    async def on(self, screen: type) -> None:
        await self.wait(lambda: isinstance(self.app.screen, screen), screen.__name__)

    async def press(self, *keys: str) -> None:
        for key in keys:
            self.app.simulate_key(key)
            await asyncio.sleep(0.2)

    async def events(self, text: str) -> None:
        await self.wait(lambda: any(text in e.text for e in self.app.desk.station.fleet.events), f"an event {text!r}")


async def journey(file: Path) -> None:
    async with Flight(FlightPlan(mission="hop")) as flight:
        app = StationApp(Desk(flight.station))
        async with app.run_test(size=(100, 32)) as pilot:
            here = Operator(app, pilot, flight.name)
            await here.wait(lambda: app.platform is not None, "a vehicle")
            await here.press("3")
            await open_and_mend(here, file)
            await fly_and_steer(here)
            await ask_for_single_actions(here)


async def open_and_mend(here: Operator, file: Path) -> None:
    await here.on(MissionScreen)
    await here.press("o")
    await here.on(OpenMission)
    here.app.screen.query_one(Input).value = str(file)
    await here.press("enter")
    await here.see("findings", "expected a number or nothing, got text")
    editor = here.app.screen.query_one(MissionEditor)
    assert editor.document.get_line(editor.cursor_location[0]).strip().startswith("side:")
    editor.load_text(editor.text.replace("slow", "0.5"))
    await here.see("findings", "no findings")
    await here.press("ctrl+s", "escape")
    await here.see("position", "u uploads it")
    assert "0.5}, after" in file.read_text()


async def fly_and_steer(here: Operator) -> None:
    await here.wait(lambda: here.app.platform is not None and not missing(here), "ready")
    await here.press("u")
    await here.events("is loaded and read back")
    await here.press("s", "y")
    await here.state("sweep.out", "running")
    await here.see("graph", "► out")
    await here.press("p")
    await here.state("", "paused")
    await here.see("graph", "paused")
    await here.press("r")
    await here.state("", "running")
    await here.press("down", "right", "down")
    await here.see("detail", "follow_waypoints 1 waypoints speed 0.5 m/s")
    await here.press("d")
    await here.on(SingleAction)
    await here.see("capabilities", "motion claimed by sweep.out")
    here.app.screen.query_one("#capabilities", ListPanel).point_at("take_off")
    await here.press("enter")
    await here.wait(lambda: isinstance(here.app.focused, Input), "a field")
    here.app.screen.query_one("#field_height_m", Input).value = "2"
    await here.press("enter")
    await here.see("reply", "refused: ")
    await here.press("escape", "escape")
    await here.on(MissionScreen)
    await here.press("k")
    await here.state("sweep.out", "skipped")
    await here.state("sweep.side", "running")
    await here.press("home", "a")
    await here.on(YesNoQuestion)
    await here.press("y")
    await here.state("", "aborted")
    await here.see("graph", "aborted")
    await here.wait(lambda: not armed(here), "landed by on_failure")


async def ask_for_single_actions(here: Operator) -> None:
    await here.press("d")
    await here.on(SingleAction)
    await here.see("capabilities", "take_off")
    here.app.screen.query_one("#capabilities", ListPanel).point_at("take_off")
    await here.press("enter")
    await here.wait(lambda: isinstance(here.app.focused, Input), "a field")
    here.app.screen.query_one("#field_height_m", Input).value = "1"
    await here.press("enter")
    await here.on(YesNoQuestion)
    await here.press("y")
    await here.see("reply", "accepted: running as command-")
    await here.press("escape", "escape")
    await here.on(MissionScreen)
    await here.see("graph", "command-")
    await here.wait(
        lambda: any(s == "done" and "command" in t for t, s in here.reported.tasks.items()), "the climb done"
    )


def missing(here: Operator) -> list[str]:
    from gloc3_groundstation.desk import flights

    platform = here.app.platform
    return flights.missing(platform, here.app.desk.station.now_s()) if platform is not None else ["a vehicle"]


def armed(here: Operator) -> bool:
    platform = here.app.platform
    return platform is not None and platform.vehicle is not None and platform.vehicle.value.is_armed


def test_a_mission_is_opened_mended_streamed_flown_paused_resumed_skipped_and_aborted_by_keys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    file = tmp_path / "journey.yaml"
    file.write_text(MISSION)
    with asyncio.Runner(loop_factory=PatientLoop) as runner:
        runner.run(journey(file))
