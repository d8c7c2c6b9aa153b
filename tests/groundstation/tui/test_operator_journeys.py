"""Journeys of an operator from end to end by keys: a mission from its file to its abort, and a link that is lost and regained."""

from pathlib import Path

import pytest
from tests.groundstation.scripted_platform import TASKS
from tests.groundstation.station_scene import TEXT, Scene, scene
from textual.widgets import Input

from gloc3.messages.command_interface import LoadMission, Steer, Verb
from gloc3.messages.summaries import MissionSummary
from gloc3.mission.model.model import digest_of
from gloc3_groundstation.missions.plans import CheckedPlan
from gloc3_groundstation.tui.dialogues.mission_files import OpenMission
from gloc3_groundstation.tui.dialogues.questions import YesNoQuestion
from gloc3_groundstation.tui.screens.mission import MissionScreen
from gloc3_groundstation.tui.widgets.mission_text import MissionEditor

pytestmark = pytest.mark.sockets


async def test_a_mission_is_opened_checked_mended_streamed_flown_paused_resumed_and_aborted(tmp_path: Path) -> None:
    file = tmp_path / "hold.yaml"
    file.write_text(TEXT.replace("after: [depart]", "after: [nowhere]"))
    async with scene(None) as here:
        here.platform.speak_every(0.3)
        await here.until("title", "heron")
        await here.go("3")
        await here.press("o")
        await here.wait(lambda: isinstance(here.app.screen, OpenMission) and isinstance(here.app.focused, Input))
        here.app.screen.query_one(Input).value = str(file)
        await here.pilot.pause()
        await here.press("enter")
        await here.until("findings", "no task 'nowhere' here")
        await here.wait(lambda: isinstance(here.app.focused, MissionEditor))
        editor = here.app.screen.query_one(MissionEditor)
        await here.wait(lambda: editor.cursor_location == (6, 12))
        await here.press(*["delete"] * len("nowhere"), *"depart")
        await here.until("findings", "no findings")
        await here.press("ctrl+s")
        await here.wait(lambda: file.read_text() == TEXT)
        await here.press("escape")
        await here.wait(lambda: not isinstance(here.app.focused, MissionEditor))
        await here.until("position", "open: hold.yaml")
        await here.press("u")
        await here.wait(lambda: any("read back" in event.text for event in here.station.fleet.events))
        here.platform.mission = MissionSummary(name="cargo hold", digest=digest_of(TEXT), state="waiting", tasks=TASKS)
        await here.press("s")
        await here.shows(YesNoQuestion)
        await here.press("y")
        await here.wait(lambda: Steer(verb=Verb.START) in here.platform.requests)
        here.platform.advance("running", {"sweep.wall": 0.42}, depart="done", sweep="running", sweep__wall="running")
        here.platform.fly(is_armed=True, mode="OFFBOARD", landed="in_air")
        await here.until("graph", "42 %")
        await _steer(here, "p", Verb.PAUSE, "paused")
        await _steer(here, "r", Verb.RESUME, "running")
        await here.press("a")
        await here.shows(YesNoQuestion)
        await here.press("y")
        await here.wait(lambda: Steer(verb=Verb.ABORT) in here.platform.requests)
        here.platform.advance("aborted", sweep="aborted", sweep__wall="aborted")
        await here.until("graph", "aborted")
        sent = [body for body in here.requested(Steer) if isinstance(body, Steer)]
        assert [body.verb for body in sent] == [Verb.START, Verb.PAUSE, Verb.RESUME, Verb.ABORT]
        assert len(here.requested(LoadMission)) == 1


async def _steer(here: Scene, key: str, verb: Verb, state: str) -> None:
    """Presses a key once it is offered, and has the platform do what it asks for."""
    base = here.app.base
    assert isinstance(base, MissionScreen)
    await here.wait(lambda: verb in base._verbs())
    await here.press(key)
    await here.wait(lambda: Steer(verb=verb) in here.platform.requests)
    here.platform.advance(state, {"sweep.wall": 0.5}, sweep=state, sweep__wall=state)
    await here.until("graph", state)


def has_event(here: Scene, text: str) -> bool:
    return any(text in event.text for event in here.station.fleet.events)


FAR = """mission: survey
frame: geo
tasks:
  all: {actions: {up: {take_off: {height_m: 9}}, go: {go_to: {position: [43.2, 9.2, 9]}, after: [up]}}}
"""


async def test_a_mission_that_begins_kilometres_away_is_asked_about_before_it_is_uploaded() -> None:
    async with scene(CheckedPlan(name="far.yaml", title="survey", text=FAR)) as here:
        here.platform.speak_every(0.3)
        await here.until("title", "heron")
        await here.wait(lambda: has_event(here, "the key u asks whether"))  # the upload at the begin
        await here.go("3")
        for answer in "ny":
            assert not here.requested(LoadMission)
            await here.press("u")
            await here.shows(YesNoQuestion)
            await here.press(answer)
            await here.wait(lambda: not isinstance(here.app.screen, YesNoQuestion))
        await here.wait(lambda: has_event(here, "is loaded and read back"))
        await here.press("s")
        await here.shows(YesNoQuestion)
        await here.press("y")
        await here.wait(lambda: Steer(verb=Verb.START) in here.platform.requests)


async def test_a_link_is_lost_and_regained_and_every_screen_says_so() -> None:
    async with scene(None) as here:
        loop, later_s = here.platform.loop, 0.0
        here.station.now_s = lambda: loop.time() + later_s  # type: ignore[misc]
        here.platform.speak()
        here.platform.fly(is_armed=True, mode="OFFBOARD", landed="in_air")
        await here.until("facts", "all 13 well")
        here.platform.is_deaf = True
        later_s = 9.0
        await here.until("title", "SILENT")
        await here.until("alert", "critical: heron: no messages from it, and it was armed")
        assert "silent for" in here.shown("facts")
        await here.go("2")
        await here.until("components", "was working")
        assert "as last heard" in here.shown("chain")
        here.platform.is_deaf = False
        here.platform.speak_every(0.3)
        await here.until("title", "link ok")
        await here.until("chain", "the data flows from end to end")
        await here.until("alert", "over since")
        await here.press("x")
        await here.wait(lambda: here.shown("alert") == "")
        await here.go("9")
        await here.until("events", "is heard again")
        lost, again = [event.text for event in here.station.fleet.events][-2:]
        assert lost.startswith("no messages from it, and it was armed")
        assert again.startswith("is heard again after ")
