"""The Checks screen by keys: the list with what to do, a refused start, and an override with a typed reason."""

import msgspec
import pytest
from tests.groundstation.scripted_platform import CHECKS, CLOCK, LINK_LOSS, ScriptedPlatform
from tests.groundstation.station_scene import PLAN, scene

from gloc3.messages.command_interface import Preflight, Steer
from gloc3.messages.preflight import Check, Group, Verdict
from gloc3_groundstation.tui.dialogues.questions import TextQuestion

pytestmark = pytest.mark.sockets


async def test_the_list_is_asked_for_when_it_is_looked_at_and_again_by_key() -> None:
    async with scene() as here:
        here.platform.speak()
        await here.go("8")
        await here.until("headline", "nothing is red")
        await here.until("checks", "link loss")
        assert len(here.requested(Preflight)) == 1
        here.platform.checks = [*CHECKS, CLOCK]
        await here.press("r")
        await here.until("checks", "12.0 s behind the autopilot's")
        assert len(here.requested(Preflight)) == 2


async def test_a_red_line_refuses_the_start_and_an_override_starts_with_its_reason() -> None:
    async with scene() as here:
        here.platform.checks = [LINK_LOSS, *CHECKS[:3]]
        here.platform.speak()
        await here.wait(lambda: any("read back" in event.text for event in here.station.fleet.events))
        await here.go("8")
        await here.until("headline", "the start is refused")
        await here.press("s", "y")
        await here.wait(lambda: any("red: failsafes: link loss" in event.text for event in here.station.fleet.events))
        await here.press("o")
        await here.shows(TextQuestion)
        await here.types("urgent")
        await here.press("enter")
        await here.wait(lambda: bool([one for one in here.requested(Steer) if getattr(one, "override", "")]))
        (steer,) = [one for one in here.requested(Steer) if getattr(one, "override", "")]
        assert isinstance(steer, Steer)
        assert steer.override == "urgent"
        await here.wait(lambda: here.platform.mission.state == "running")


async def test_an_override_shows_the_red_lines_of_every_vehicle_that_it_starts() -> None:
    async with scene(None) as here:
        other = ScriptedPlatform(here.exchange, "stork", 20)
        other.checks = [Check(Group.AUTOPILOT, "battery", Verdict.RED, "3 %", "charge it")]
        here.platform.speak()
        other.speak()
        await here.go("8")
        await here.until("headline", "nothing is red")
        assert here.app.base is not None
        assert here.app.base.check_action("override", ()) is None
        here.app.desk.missions._plan = msgspec.structs.replace(PLAN, platforms=("heron", "stork"))
        await here.press("r")
        await here.wait(lambda: here.app.base is not None and here.app.base.check_action("override", ()) is True)
        await here.press("o")
        await here.shows(TextQuestion)
        question = getattr(here.app.screen, "_question", "")
        assert "Start heron, stork although checks are red?" in question
        assert "✗ stork: autopilot: battery: 3 %" in question


async def test_without_a_reason_nothing_is_started() -> None:
    async with scene() as here:
        here.platform.checks = [LINK_LOSS]
        here.platform.speak()
        await here.go("8")
        await here.until("headline", "the start is refused")
        await here.press("o")
        await here.shows(TextQuestion)
        await here.field()
        await here.press("enter")
        await here.wait(lambda: not isinstance(here.app.screen, TextQuestion))
        assert not here.requested(Steer)


async def test_before_a_vehicle_is_heard_it_says_what_is_waited_for() -> None:
    async with scene() as here:
        await here.go("8")
        await here.until("checks", "14550")
