"""The health screen, driven by keys: from a component's fault to its resumption; force; functions."""

import pytest
from tests.groundstation.scripted_platform import refused
from tests.groundstation.station_scene import Scene, scene
from textual.widgets import Input, Static

from gloc3.messages.command_interface import CallFunction, CommandComponent, Steer, Verb
from gloc3.messages.summaries import Health
from gloc3_groundstation.tui.dialogues.component_dialogues import ComponentMenu, FunctionForm
from gloc3_groundstation.tui.dialogues.questions import YesNoQuestion
from gloc3_groundstation.tui.widgets.lines import text_of
from gloc3_groundstation.tui.widgets.panel import ListPanel

pytestmark = pytest.mark.sockets


async def open_menu(here: Scene) -> str:
    """Enter on the component under the cursor; what is offered."""
    await here.press("enter")
    await here.wait(lambda: isinstance(here.app.screen, ComponentMenu) and bool(here.app.screen.query(ListPanel)))
    menu = here.app.screen.query_one(ListPanel)
    await here.wait(lambda: bool(menu.chosen))
    return "\n".join(text_of(line) for line in menu.lines)


async def test_an_operator_sees_a_fault_reads_its_cause_reinitializes_and_resumes() -> None:
    async with scene() as here:
        here.platform.speak()
        await here.until("events", "is loaded and read back")
        await here.press("s", "y")
        await here.until("events", "the mission is started")
        here.platform.problem("pose", "ValueError: covariance is not positive\nat 12.3 s")
        here.platform.advance("paused")
        here.platform.speak()
        await here.until("alert", "pose is faulty")
        await here.press("2")
        await here.until("chain", "the data stops at DP: pose is faulty")
        await here.press("down", "down", "down")
        await here.until("component", "ValueError: covariance is not positive")
        offered = await open_menu(here)
        assert [line.split()[0] for line in offered.splitlines()] == ["initialize", "finish", "shutdown"]
        await here.press("enter")
        await here.until("component", "initialize: state standby")
        await here.until("chain", "pose is standby")
        assert (await open_menu(here)).split()[:4] == ["initialize", "then", "standby", "start"]
        await here.press("down", "enter")
        await here.until("component", "start: state working")
        await here.until("chain", "the data flows from end to end")
        await here.press("r")
        await here.wait(lambda: Steer(verb=Verb.RESUME) in here.platform.requests)


async def test_what_a_running_action_needs_is_forced_only_after_a_question() -> None:
    async with scene(None) as here:
        here.platform.speak()
        await here.go("2")
        await here.until("components", "pose_backup")
        here.platform.answer_next(
            CommandComponent, refused("sweep.wall needs autopilot; pause it, or force the command")
        )
        await open_menu(here)
        await here.press("down", "enter")
        await here.shows(YesNoQuestion)
        question = here.app.screen
        assert isinstance(question, YesNoQuestion)
        assert "sweep.wall needs autopilot" in question._question
        assert here.platform.states["autopilot"] is Health.WORKING
        await here.press("y")
        await here.wait(lambda: here.platform.states["autopilot"] is Health.STANDBY)
        forced = [body for body in here.platform.requests if isinstance(body, CommandComponent)]
        assert [body.is_forced for body in forced] == [False, True]


async def test_stopping_what_an_armed_vehicle_requires_names_what_follows_and_asks() -> None:
    async with scene(None) as here:
        here.platform.speak()
        here.platform.fly(is_armed=True)
        await here.go("2")
        await here.until("components", "pose_backup")
        await open_menu(here)
        await here.press("down", "enter")
        await here.shows(YesNoQuestion)
        question = here.app.screen
        assert isinstance(question, YesNoQuestion)
        assert "heron is ARMED and requires it; nothing replaces it" in question._question
        await here.press("n")
        await here.pilot.pause()
        assert not [body for body in here.platform.requests if isinstance(body, CommandComponent)]
        await open_menu(here)
        await here.press("down", "enter")
        await here.shows(YesNoQuestion)
        await here.press("y")
        await here.wait(lambda: here.platform.states["autopilot"] is Health.STANDBY)


async def test_a_functions_form_checks_what_is_typed_and_shows_the_reply() -> None:
    async with scene(None) as here:
        here.platform.speak()
        await here.go("2")
        await here.until("components", "pose_backup")
        offered = await open_menu(here)
        assert "set_rate…" in offered
        await here.press("end", "up", "enter")
        await here.wait(lambda: isinstance(here.app.screen, FunctionForm) and bool(here.app.screen.query(Input)))
        form = here.app.screen
        typed = form.query_one(Input)
        assert typed.placeholder == "required"
        await here.wait(lambda: here.app.focused is typed)
        typed.value = "0"
        await here.press("enter")
        await here.wait(lambda: "rate_hz" in str(form.query_one("#form_error", Static).content))
        assert not here.requested(CallFunction)
        typed.value = "5"
        await here.press("enter")
        await here.until("component", "set_rate: rate_hz 5.0")
