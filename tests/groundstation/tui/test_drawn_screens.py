"""All screens and dialogues at the smallest size: nothing that they say is clipped, and their colours can be read."""

from unittest.mock import patch

import pytest
from tests.groundstation.drawn import READABLE, apart, clipped, contrasts
from tests.groundstation.poses import GROUPS, poses, problems, settle
from tests.groundstation.scripted_platform import ScriptedPlatform
from tests.groundstation.station_scene import Scene, scene
from textual.command import CommandPalette
from textual.widgets import OptionList

from gloc3_groundstation.store.configuration import Configuration
from gloc3_groundstation.tui.dialogues.questions import YesNoQuestion
from gloc3_groundstation.tui.screen import SMALLEST
from gloc3_groundstation.tui.widgets.panel import ListPanel, Panel

pytestmark = pytest.mark.sockets


@pytest.mark.parametrize("group", GROUPS)
async def test_nothing_is_clipped_at_the_smallest_size_and_all_colours_can_be_read(group: str) -> None:
    found = {}
    async for name, here in poses(SMALLEST, wanted=(group,)):
        found[name] = await problems(here)
    assert found
    assert {name: wrong for name, wrong in found.items() if wrong} == {}


async def test_a_text_that_does_not_fit_is_found() -> None:
    async with scene(None) as here:
        here.platform.speak()
        await here.until("facts", "all 13 well")
        snapshot = here.app.screen.query_one("#facts", Panel)
        long = (snapshot.lines[0][0]._replace(text="x" * 80),)
        snapshot.show([long] * 20)
        assert len(clipped(here.app)) > 1


async def test_the_cursor_goes_with_the_vehicle_in_view() -> None:
    async with scene(None) as here:
        here.platform.speak()
        await here.until("title", "heron")
        ScriptedPlatform(here.exchange, "egret", 9).speak()
        await here.until("vehicles", "egret")
        await here.press("v")
        await here.until("title", "egret 2/2")
        assert here.app.screen.query_one(ListPanel).chosen == "egret"


async def test_control_q_asks_before_it_leaves_an_armed_vehicle() -> None:
    async with scene() as here:
        here.platform.speak()
        await here.until("title", "in control")
        here.platform.fly(is_armed=True)
        await here.until("title", "ARMED")
        await here.press("ctrl+q")
        await here.shows(YesNoQuestion)


async def test_without_colours_the_chosen_command_of_the_palette_is_marked() -> None:
    async with scene(None, configuration=Configuration(theme="mono")) as here:
        here.platform.speak()
        await here.until("facts", "all 13 well")
        await here.press("ctrl+p")
        await here.shows(CommandPalette)
        await here.wait(lambda: any(found.option_count for found in here.app.screen.query(OptionList)))
        commands = here.app.screen.query_one(OptionList)
        await here.wait(lambda: commands.highlighted is not None and commands.size.height > 0)
        first = [segment.style for segment in commands.render_line(0) if segment.text.strip()]
        assert any(style is not None and style.underline for style in first)


@pytest.mark.parametrize("theme", ["dark", "daylight"])
def test_states_are_told_apart_also_by_those_who_see_red_and_green_alike(theme: str) -> None:
    assert min(apart(theme).values()) > 10.0


async def test_a_screen_that_was_seen_before_is_shown_without_new_styles_unless_the_theme_is_another() -> None:
    async with scene(None) as here:
        here.platform.speak()
        for digit in "212":
            await here.go(digit)
        with patch.object(here.app, "update_styles") as update:
            await here.go("1")
            assert [call for call in update.call_args_list if call.args[0] is here.app.base] == []
        here.app.theme = "daylight"
        await here.go("2")
        await here.wait(lambda: "#e6e9ec" in backgrounds(here))


def backgrounds(here: Scene) -> set[str]:
    """Behind the title."""
    strip = here.app.screen.query_one("#title", Panel).render_line(0)
    styles = [segment.style for segment in strip if segment.style is not None and segment.style.bgcolor is not None]
    return {style.bgcolor.name for style in styles if style.bgcolor is not None}


async def test_what_is_selected_in_a_line_can_be_read() -> None:
    async with scene(None) as here:
        here.platform.speak()
        await here.go("9")
        await here.press("e")
        (await here.field()).select_all()
        await settle(here)
        assert [each for each in contrasts(here.app) if each.ratio < READABLE] == []
        assert any("events.csv" in each.text for each in contrasts(here.app))
