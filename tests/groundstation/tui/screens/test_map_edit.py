"""The open mission edited on the map: keys, mouse, undo, findings, saving, and sending the vehicle to a place."""

from pathlib import Path

import pytest
from msgspec.structs import replace
from tests.groundstation.flown import SITE, flown_on_the_map
from tests.groundstation.station_scene import PLAN, TEXT, Scene, scene

from gloc3.messages.command_interface import RequestAction
from gloc3_groundstation.tui.dialogues.questions import TextQuestion, YesNoQuestion
from gloc3_groundstation.tui.screens.map import MapScreen
from gloc3_groundstation.tui.screens.mission import MissionScreen
from gloc3_groundstation.tui.widgets.mission_text import MissionText

pytestmark = pytest.mark.sockets

FENCED = TEXT.replace(
    "on_failure", "geofence: {polygon_m: [[-2, -2], [14, -2], [14, 8], [-2, 8]]}  # walls\non_failure"
)


def shown_map(here: Scene) -> MapScreen:
    assert isinstance(here.app.base, MapScreen)
    return here.app.base


def text_of(here: Scene) -> str:
    draft = here.app.desk.missions.draft
    assert draft is not None
    return draft.text


def new_lines(here: Scene, before: str) -> list[str]:
    return [line for line in text_of(here).splitlines() if line not in before.splitlines()]


async def begin(here: Scene) -> None:
    """Shows the map with the vehicle, and edits the open mission on it."""
    await flown_on_the_map(here, 5.0)
    await here.press("e")
    await here.wait(lambda: shown_map(here).edit.is_on and shown_map(here).edit.state.places is not None)


def cell(here: Scene, x_m: float, y_m: float) -> tuple[int, int]:
    """Column and line, in the panel, of a place of the frame whose x points to the north."""
    x, y = shown_map(here)._projection.dot(x_m, -y_m)
    gutter = shown_map(here).query_one("#map").gutter
    return int(x // 2) + gutter.left, int(y // 4) + gutter.top


async def test_a_waypoint_is_carried_by_keys_and_every_step_is_undone() -> None:
    plan = PLAN.__class__(name="hold.yaml", title="cargo hold", text=FENCED)
    async with scene(plan, size=(120, 40)) as here:
        await begin(here)
        await here.until("vehicles", "hold.yaml")
        await here.press("n", "n")
        await here.until("vehicles", "waypoint 2 of sweep.wall")
        await here.press("enter", "right", "right", "up", "enter")
        (moved,) = new_lines(here, FENCED)
        assert moved.startswith("      wall: {follow_waypoints: {waypoints_m: [[2, 1, 2], [1")
        assert moved.endswith("[12, 5, 3]], speed_m_s: 0.5}}")
        await here.press("plus")
        await here.wait(lambda: ", 3], [12, 5, 3]]" in text_of(here))
        await here.until("vehicles", "height 3 m")
        await here.press("ctrl+z", "ctrl+z")
        await here.wait(lambda: text_of(here) == FENCED)
        await here.press("ctrl+y")
        await here.wait(lambda: new_lines(here, FENCED) == [moved])


async def test_a_waypoint_that_is_dragged_outside_the_fence_is_told_at_once_with_the_distance() -> None:
    plan = PLAN.__class__(name="hold.yaml", title="cargo hold", text=FENCED)
    async with scene(plan, size=(120, 40)) as here:
        await begin(here)
        near_m = shown_map(here)._projection.m_per_dot
        await here.press("minus", "minus", "minus", "minus")
        await here.wait(lambda: shown_map(here)._projection.m_per_dot == pytest.approx(4.0 * near_m))
        start, end = cell(here, 12.0, 1.0), cell(here, 20.0, 1.0)
        await here.pilot.mouse_down("#map", offset=start)
        await here.pilot.hover("#map", offset=end)
        await here.until("cursor", "m outside the fence")
        assert text_of(here) == FENCED, "it is only placed when the button is released"
        await here.pilot.mouse_up("#map", offset=end)
        await here.wait(lambda: text_of(here) != FENCED)
        assert "# walls" in text_of(here)
        await here.until("vehicles", "m outside")
        assert here.app.desk.missions.draft is not None
        await here.wait(lambda: bool(here.app.desk.missions.draft and here.app.desk.missions.draft.findings))
        messages = [finding.message for finding in here.app.desk.missions.draft.findings]
        assert any(one.startswith("waypoint 2 is ") and one.endswith(" m outside the fence") for one in messages)


async def test_waypoints_are_added_and_left_out_and_a_survey_is_drawn(tmp_path: Path) -> None:
    async with scene(size=(120, 40)) as here:
        await begin(here)
        await here.press("i")
        await here.wait(lambda: text_of(here) != TEXT)
        (line,) = new_lines(here, TEXT)
        assert line.count("], [") == 3
        await here.press("delete")
        await here.wait(lambda: text_of(here) == TEXT)
        await here.press("m", "enter", "right", "right", "right", "right", "enter", "down", "down", "down", "enter")
        await here.press("up", "up", "up", "left", "left", "left", "left", "enter")
        await here.shows(TextQuestion)
        await here.enter()
        await here.wait(lambda: "survey: {survey: {area_m: [[" in text_of(here))
        assert "wall: {follow_waypoints" in text_of(here)
        del tmp_path


async def test_the_editor_shows_what_the_map_has_changed() -> None:
    async with scene(size=(120, 40)) as here:
        await here.go("3")
        await here.press("e")
        assert isinstance(here.app.base, MissionScreen)
        await here.wait(lambda: here.app.base is not None and here.app.base.query_one(MissionText).editor.text == TEXT)
        await here.press("escape")
        await begin(here)
        await here.press("i")
        await here.wait(lambda: text_of(here) != TEXT)
        await here.go("3")
        await here.press("e")
        await here.wait(
            lambda: here.app.base is not None and here.app.base.query_one(MissionText).editor.text == text_of(here)
        )


async def test_a_vehicle_is_sent_to_the_crosshair_after_a_height_and_a_confirmation() -> None:
    async with scene(plan=None, size=(80, 24)) as here:
        await flown_on_the_map(here, 5.0)
        await here.press("g")
        await here.shows(TextQuestion)
        await here.enter()
        await here.shows(YesNoQuestion)
        assert not here.requested(RequestAction)
        await here.press("y")
        await here.wait(lambda: bool(here.requested(RequestAction)))
        (asked,) = here.requested(RequestAction)
        assert isinstance(asked, RequestAction)
        assert asked.capability == "go_to"
        assert len(next(iter(asked.arguments.values()))) == 3
        assert SITE.frame == "hold"


@pytest.mark.parametrize(("height_cm", "proposed"), [(-800, "-8.0"), (-2, "0.0"), (250, "2.5")])
async def test_the_height_that_is_proposed_is_that_of_the_vehicle_under_water_too(
    height_cm: int, proposed: str
) -> None:
    async with scene(plan=None, size=(80, 24)) as here:
        await flown_on_the_map(here, 5.0)
        motion = here.station.fleet.platforms["heron"].motion
        assert motion is not None
        there = replace(motion.value, position_cm=(200, 100, height_cm))
        here.platform.report("motion", there)
        await here.wait(lambda: getattr(here.station.fleet.platforms["heron"].motion, "value", None) == there)
        here.app.show_fleet()
        await here.press("g")
        await here.shows(TextQuestion)
        assert (await here.field()).value == proposed


async def test_the_wheel_zooms_about_the_mouse_and_a_drag_moves_the_map() -> None:
    async with scene(plan=None, size=(120, 40)) as here:
        await flown_on_the_map(here, 5.0)
        screen = shown_map(here)
        await here.wait(lambda: screen._projection.width < 2 * 120)  # the list of vehicles is beside it
        before = screen._projection
        await here.pilot.mouse_down("#map", offset=(20, 10))
        await here.pilot.hover("#map", offset=(26, 10))
        await here.pilot.mouse_up("#map", offset=(26, 10))
        await here.wait(lambda: screen._projection.east_m == pytest.approx(before.east_m - 12 * before.m_per_dot))
        assert not screen.edit.is_on
