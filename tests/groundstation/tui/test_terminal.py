"""The terminal, driven by keys: journeys of an operator with a scripted platform."""

from unittest.mock import patch

import msgspec
import pytest
from msgspec.structs import replace
from tests.groundstation.scripted_platform import ScriptedPlatform, refused
from tests.groundstation.station_scene import PLAN, Scene, scene
from textual.command import CommandPalette
from textual.widgets import ContentSwitcher, Input, OptionList, Static

from gloc3.messages.command_interface import Emergency, EmergencyVerb, LoadMission, Steer, Verb
from gloc3.messages.summaries import ControlState
from gloc3.mission.model.model import digest_of
from gloc3_groundstation.desk.flights import End
from gloc3_groundstation.station.fleet import with_platform
from gloc3_groundstation.station.snapshots import AutopilotSnapshot, Fleet
from gloc3_groundstation.store.configuration import Configuration, LastSession
from gloc3_groundstation.tui.dialogues.questions import EmergencyQuestion, TextQuestion, YesNoQuestion
from gloc3_groundstation.tui.help import HelpScreen
from gloc3_groundstation.tui.screens.table import SCREENS
from gloc3_groundstation.tui.widgets.lines import text_of
from gloc3_groundstation.tui.widgets.panel import Panel

pytestmark = pytest.mark.thorough


async def test_what_comes_is_shown_and_keys_that_make_no_sense_do_nothing() -> None:
    async with scene(None) as here:
        assert "Waiting for a platform on udpin://0.0.0.0:14550." in here.shown("vehicles")
        here.platform.speak()
        await here.until("facts", "all 13 well")
        assert "HOLD   disarmed   bat 97 %   link ok" in here.shown("title")
        panel = here.app.screen.query_one("#facts", Panel)
        await here.press("s", "p", "r", "a", "u")
        await here.pilot.pause()
        assert here.requested(Steer) == here.requested(LoadMission) == []
        here.app.show_fleet()
        with patch.object(panel, "refresh") as refresh:
            here.app.show_fleet()
            assert not refresh.called, "nothing has changed, so nothing is drawn"
        for number in range(40):
            here.platform.event(f"number {number}")
        here.app.show_fleet()
        await here.pilot.pause()
        events = here.app.screen.query_one("#events", Panel)
        assert "number 39" in events.render_line(events.size.height - 1).text


async def test_a_vehicle_s_text_does_not_steer_the_terminal() -> None:
    async with scene(None) as here:
        here.platform.speak()
        here.platform.event("\x1b[2J \u202eend")
        await here.until("events", "end")
        events = here.app.screen.query_one("#events", Panel)
        drawn = [segment.text for row in range(events.size.height) for segment in events.render_line(row)]
        assert any("\ufffd[2J \ufffdend" in text for text in drawn)


async def test_what_comes_while_it_ends_is_shown_to_nobody() -> None:
    async with scene(None) as here:
        pass
    assert not here.app.screen_stack
    here.app._was_possible = None  # as if what is possible had changed meanwhile
    here.app.show_fleet()


async def test_a_mission_is_streamed_started_paused_resumed_and_aborted_by_keys() -> None:
    async with scene() as here:
        here.platform.answer_next(Steer, refused("pose is faulty"))
        here.platform.speak()
        await here.until("events", "is loaded and read back")
        await here.press("s", "n")
        assert not here.requested(Steer), "what arms the vehicle is asked about first"
        await here.press("s", "y")
        await here.until("events", "error: heron: start: pose is faulty")
        here.platform.fly(is_armed=True)
        await here.until("title", "ARMED")
        await here.press("s")
        await here.until("events", "the mission is started")
        assert len(here.requested(LoadMission)) == 1
        await here.until("mission", "depart")
        await here.press("p")
        await here.until("events", "pause: accepted")
        digest = digest_of(here.platform.text)
        here.platform.mission = msgspec.structs.replace(here.platform.mission, digest=digest)
        here.platform.advance("paused")
        here.app.show_fleet()
        await here.press("r")
        await here.until("events", "resume: accepted")
        here.platform.advance("running")
        here.app.show_fleet()
        await here.press("a")
        await here.shows(YesNoQuestion)
        question = here.app.screen
        assert isinstance(question, YesNoQuestion)
        assert "it then lands here" in question._question
        await here.press("n", "a", "y")
        await here.until("events", "abort: accepted")
        verbs = (Verb.START, Verb.START, Verb.PAUSE, Verb.RESUME, Verb.ABORT)
        assert here.requested(Steer) == [Steer(verb=verb) for verb in verbs]


async def test_a_start_asks_about_the_vehicles_that_the_mission_names_even_where_they_are_armed() -> None:
    async with scene(None) as here:
        here.platform.speak()
        here.platform.fly(is_armed=True)
        await here.until("title", "ARMED")
        here.app.desk.missions._plan = msgspec.structs.replace(PLAN, platforms=("egret", "stork"))
        await here.press("s")
        await here.shows(YesNoQuestion)
        question = getattr(here.app.screen, "_question", "")
        assert question == "Start cargo hold on egret, stork?\nThey arm and start moving."


@pytest.mark.sockets
async def test_the_emergency_key_holds_at_once_offers_more_when_pressed_again_and_leaving_is_asked() -> None:
    async with scene(None) as here:
        here.platform.control = ControlState(holder="255")
        here.platform.speak()
        here.platform.fly(is_armed=True)
        await here.until("title", "ARMED")
        await here.press("space")
        await here.until("events", "emergency hold")
        await here.press("space", "l")
        await here.until("events", "emergency land")
        await here.press("space", "d")
        await here.wait(lambda: isinstance(here.app.focused, Input))
        typed = here.app.screen.query_one(Input)
        typed.value = "herron"
        await here.press("enter")
        await here.wait(lambda: typed.value == "")
        typed.value = "heron"
        await here.press("enter")
        await here.until("events", "emergency disarm")
        verbs = [getattr(body, "verb", None) for body in here.requested(Emergency)]
        assert verbs == [EmergencyVerb.HOLD, EmergencyVerb.HOLD, EmergencyVerb.LAND, EmergencyVerb.DISARM]
        assert getattr(here.requested(Emergency)[-1], "confirmation", "") == "heron"
        await here.press("q", "n")
        assert not here.app._exit
        await here.press("q", "ctrl+c")
        assert here.app._exit
        assert here.app.return_code == 130, "Ctrl-C asks nothing"


@pytest.mark.sockets
async def test_the_emergency_key_holds_at_once_again_after_a_resume() -> None:
    async with scene(None) as here:
        here.platform.control = ControlState(holder="255")
        await here.trouble_in_flight()
        await here.until("title", "ARMED")
        await here.press("space")
        await here.wait(lambda: len(here.requested(Emergency)) == 1)
        here.platform.advance("paused")
        here.app.show_fleet()
        await here.press("r")
        await here.until("events", "resume: accepted")
        await here.press("space")
        await here.wait(lambda: len(here.requested(Emergency)) == 2)
        assert here.requested(Emergency)[-1] == here.requested(Emergency)[0]
        await here.shows(EmergencyQuestion)


@pytest.mark.sockets
async def test_a_disarming_confirmed_for_the_autopilot_is_not_sent_to_a_companion_that_is_back() -> None:
    heard = AutopilotSnapshot(link="udpin://127.0.0.1:14550", system=1, component=1, firmware="PX4")

    def silent(fleet: Fleet, now_s: float) -> Fleet:
        return with_platform(fleet, replace(fleet.platforms["heron"], received_s=now_s - 60.0, autopilot=heard))

    async with scene(None) as here:
        here.platform.control = ControlState(holder="255")
        here.platform.speak()
        here.platform.fly(is_armed=True, landed="in_air")
        await here.until("facts", "all 13 well")
        here.station.change(silent)
        await here.press("space")
        await here.until("events", "has no link")
        await here.press("space")
        await here.shows(EmergencyQuestion)
        assert "refused in flight" in "".join(str(line.content) for line in here.app.screen.query(Static))
        here.platform.speak_every(0.3)
        await here.press("d")
        await here.types("heron")
        await here.press("enter")
        await here.until("events", "give it again")
        assert here.requested(Emergency) == []


@pytest.mark.sockets
async def test_it_flies_by_itself_and_closes_when_the_mission_has_ended() -> None:
    async with scene(flies=True) as here:
        here.platform.speak_every(0.3)
        await here.until("events", "the mission is started")
        here.platform.advance("running")
        await here.until("vehicles", "running")
        here.platform.advance("done")
        await here.wait(lambda: here.app._exit)
        assert here.app.return_value == End(state="done")


@pytest.mark.sockets
@pytest.mark.parametrize(("written_for", "receives"), [("egret", "egret"), ("", "")])
async def test_the_mission_of_the_command_line_goes_to_its_vehicle_not_to_the_first_that_is_heard(
    written_for: str, receives: str
) -> None:
    plan = msgspec.structs.replace(PLAN, written_for=written_for)
    async with scene(plan, flies=True) as here:
        egret = ScriptedPlatform(here.exchange, "egret", 9)
        here.platform.speak_every(0.2)
        egret.loop.call_later(0.5, egret.speak_every, 0.2)
        if receives:
            await here.wait(lambda: Steer(verb=Verb.START) in egret.requests)
            await here.until("title", "egret")
        else:
            await here.wait(lambda: here.app._exit)
            text = "'cargo hold' is not uploaded: several platforms are in contact (heron, egret): name one"
            assert any(event.text.startswith(text) for event in here.station.fleet.events)
            assert not any(isinstance(body, LoadMission) for body in egret.requests)
        assert not here.requested(LoadMission), "heron was the first one"
        egret.is_deaf = True


@pytest.mark.sockets
async def test_digits_and_function_keys_show_the_screens_and_only_the_one_that_is_shown_is_filled() -> None:
    async with scene(None) as here:
        here.platform.speak()
        await here.until("facts", "all 13 well")
        assert [row.key for row in SCREENS] == sorted((row.key for row in SCREENS), key=lambda key: (key == "0", key))
        for row in SCREENS:
            await here.go(row.key)
            assert here.app.current_mode == row.name
        await here.go("f2")
        await here.until("components", "command_server")
        overview = here.app._screen_stacks["overview"][0]
        with patch.object(type(overview), "show_view") as poll:
            here.app.show_fleet()
            assert not poll.called
        await here.press("down", "down", "down")
        await here.until("component", "data processor, required, 20 Hz")


@pytest.mark.sockets
async def test_help_tells_the_keys_of_the_screen_and_those_that_work_everywhere() -> None:
    async with scene(None) as here:
        await here.go("3")
        await here.press("question_mark")
        await here.wait(
            lambda: isinstance(here.app.screen, HelpScreen) and any(each.lines for each in here.app.screen.query(Panel))
        )
        screen = here.app.screen
        assert isinstance(screen, HelpScreen)
        text = "\n".join(text_of(line) for line in screen.query_one(Panel).lines)
        assert "a         Abort: cancels it, then runs on_failure; asks first" in text
        assert "space     HOLD: the vehicle holds at once" in text
        assert "1         Overview: fleet, vehicle in view, alerts and events" in text
        await here.press("escape")
        await here.wait(lambda: here.app.screen is not screen)
    assert all(row.screen.HELP.strip() for row in SCREENS), "every screen says what it is for"


@pytest.mark.sockets
async def test_an_alert_stands_on_every_screen_until_it_is_acknowledged() -> None:
    async with scene(None) as here:
        here.platform.speak()
        here.platform.fly(battery_percent=12)
        await here.until("alert", "critical: heron: battery at or below 15 %")
        await here.go("9")
        assert "battery at or below 15 %" in here.shown("alert")
        assert "1 alert" in here.shown("title")
        await here.press("x")
        await here.wait(lambda: here.shown("alert") == "")
        assert "1 known" in here.shown("title")


@pytest.mark.sockets
async def test_the_key_of_alerts_dismisses_a_refusal_first_and_acknowledges_only_an_alert_that_was_shown() -> None:
    async with scene(None) as here:
        here.platform.answer_next(Emergency, refused("the autopilot does not answer"))
        here.platform.speak()
        await here.until("title", "heron")
        await here.press("space")
        await here.until("alert", "the autopilot does not answer")
        here.platform.fly(battery_percent=9)
        await here.until("title", "1 alert")
        assert "the autopilot does not answer" in here.shown("alert")
        await here.press("x")
        await here.until("alert", "critical: heron: battery at or below 15 %")
        await here.press("x")
        await here.wait(lambda: here.shown("alert") == "")
        assert not here.app.desk.alerts().pending


@pytest.mark.sockets
async def test_the_palette_offers_what_can_be_done_now() -> None:
    async with scene(None) as here:
        here.platform.speak()
        await here.until("facts", "all 13 well")
        await here.press("ctrl+p")
        await here.shows(CommandPalette)
        await here.wait(lambda: any(found.option_count for found in here.app.screen.query(OptionList)))
        here.app.screen.query_one(Input).value = "daylight"
        await here.wait(lambda: here.app.screen.query_one(OptionList).option_count == 1)
        await here.press("enter")
        await here.wait(lambda: here.app.theme == "daylight")
        assert here.app.configuration().theme == "daylight"
        await choose(here, "export")
        await here.wait(lambda: isinstance(here.app.screen, TextQuestion) and here.app.current_mode == "events")
        await here.press("escape")
        await here.wait(lambda: here.app.screen is here.app.base)
        await choose(here, "logs: list")
        await here.wait(lambda: here.app.current_mode == "services")
        await here.wait(lambda: here.app.screen.query_one(ContentSwitcher).current == "logs")


async def choose(here: Scene, query: str) -> None:
    """Takes the first that the command palette finds."""
    await here.press("ctrl+p")
    await here.shows(CommandPalette)
    here.app.screen.query_one(Input).value = query
    await here.wait(lambda: here.app.screen.query_one(OptionList).option_count > 0)
    await here.pilot.pause(0.1)
    await here.press("enter")


async def test_the_vehicle_key_looks_at_the_next_and_what_was_in_view_is_kept_for_next_time() -> None:
    last = Configuration(session=LastSession(platform="egret", screen="health"))
    async with scene(None, configuration=last) as here:
        assert here.app.current_mode == "health"
        here.platform.speak()
        await here.until("title", "heron")
        egret = ScriptedPlatform(here.exchange, "egret", 9)
        egret.speak()
        await here.until("title", "egret 2/2")
        await here.press("v")
        await here.until("title", "heron 1/2")
        await here.go("4")
    kept = here.app.configuration().session  # as the session asks for it: when the terminal has closed
    assert (kept.platform, kept.screen) == ("heron", "map")


@pytest.mark.sockets
async def test_a_terminal_that_is_too_small_says_so_and_the_emergency_key_works_on() -> None:
    async with scene(None, size=(60, 20)) as here:
        here.platform.speak()
        assert "This terminal has 60 × 20 characters." in here.shown("too_small")
        assert not here.app.screen.query_one("#body").display
        await here.press("space")
        await here.wait(lambda: bool(here.requested(Emergency)))
        await here.pilot.resize_terminal(80, 24)
        await here.until("title", "heron")
        await here.wait(lambda: here.app.screen.query_one("#body").display)


@pytest.mark.sockets
async def test_keys_screens_and_the_alert_can_be_clicked() -> None:
    async with scene() as here:
        here.platform.speak()
        await here.until("keys", "s Start")
        await here.pilot.click("#keys", offset=(here.shown("keys").index("Start"), 0))
        await here.shows(YesNoQuestion)
        await here.press("y")
        await here.until("events", "the mission is started")
        await here.pilot.click("#keys", offset=(here.shown("keys").index("HOLD"), 0))
        await here.until("events", "emergency hold")
        await here.pilot.click("#keys", offset=(79, 0))
        here.platform.fly(battery_percent=12)
        await here.until("alert", "battery at or below 15 %")
        await here.pilot.click("#alert", offset=(20, 0))
        await here.wait(lambda: "battery" not in here.shown("alert"))
        for title, name in (("9Events", "events"), ("3Mission", "mission"), ("1Overview", "overview")):
            await here.pilot.click("#tabs", offset=(here.shown("tabs").index(title) + len(title) - 1, 0))
            await here.wait(lambda name=name: here.app.current_mode == name and here.is_shown(name))  # type: ignore[misc]


@pytest.mark.sockets
async def test_the_line_of_keys_is_laid_out_anew_when_the_terminal_is_made_narrower() -> None:
    async with scene(None, size=(250, 70)) as here:
        here.platform.speak()
        await here.until("keys", "? Help")
        now_s = here.station.now_s()
        here.station.now_s = lambda: now_s  # type: ignore[misc]  # nothing else changes the keys
        await here.pilot.resize_terminal(80, 24)
        await here.wait(lambda: len(here.shown("keys")) <= 80)
        assert here.shown("keys").rstrip().endswith("space HOLD  ? Help")


@pytest.mark.sockets
async def test_the_emergency_key_works_over_a_dialogue_and_while_typing_with_control() -> None:
    async with scene(None) as here:
        here.platform.speak()
        await here.until("facts", "all 13 well")
        await here.press("ctrl+p")
        await here.wait(lambda: isinstance(here.app.focused, Input))
        await here.pilot.press("space")
        await here.wait(lambda: here.app.screen.query_one(Input).value == " ")
        assert here.requested(Emergency) == [], "what is typed is typed"
        await here.press("ctrl+@")
        await here.wait(lambda: len(here.requested(Emergency)) == 1)
        await here.press("escape")
        await here.wait(lambda: here.app.screen is here.app.base)
        here.app.desk._emergencies.clear()
        await here.press("question_mark")
        await here.shows(HelpScreen)
        await here.press("space")
        await here.wait(lambda: len(here.requested(Emergency)) == 2)


@pytest.mark.sockets
async def test_no_color_shows_no_colours_and_leaves_the_chosen_theme(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    async with scene(None, configuration=Configuration(theme="daylight")) as here:
        assert here.app.theme == "mono"
        assert here.app.configuration().theme == "daylight"
        here.platform.speak()
        here.platform.fly(battery_percent=9)
        await here.until("title", "bat 9 %")
        title = here.app.screen.query_one("#title", Panel).render_line(0)
        styles = [segment.style for segment in title if segment.style is not None]
        assert {style.color.name for style in styles if style.color} <= {"default"}
        assert any(style.reverse and style.bold for style in styles), "an alarm is told by reverse"


async def test_a_high_terminal_shows_all_details_of_the_vehicle() -> None:
    async with scene(None, size=(80, 60)) as here:
        here.platform.speak()
        await here.until("facts", "utc")
        facts = here.app.screen.query_one("#facts")
        assert facts.size.height >= here.shown("facts").count("\n") + 1
