"""Rally points and home of the simulated vehicle are edited on the map by keys and mouse, over UDP, and read back."""

from pathlib import Path

import pytest
from tests.groundstation.flown import flown_on_the_map
from tests.groundstation.station_scene import Scene, scene
from textual.widgets import Input

from gloc3.errors import Refused
from gloc3.messages.frames import GeoPoint
from gloc3_groundstation.desk.vehicle_desk import VehicleDesk
from gloc3_groundstation.station.snapshots import AutopilotSnapshot
from gloc3_groundstation.tui.dialogues.questions import TextQuestion, YesNoQuestion
from gloc3_groundstation.tui.screens.map import MapScreen

from .test_bare_vehicle_journey import events, has_begun
from .test_services_journey import VEHICLES, terminal

pytestmark = [pytest.mark.sockets]


def shown_map(here: Scene) -> MapScreen:
    assert isinstance(here.app.base, MapScreen)
    return here.app.base


def autopilot(here: Scene, name: str) -> AutopilotSnapshot:
    found = here.station.fleet.platforms[name].autopilot
    assert found is not None
    return found


async def begin(here: Scene, name: str) -> VehicleDesk:
    """Shows the map with the vehicle, and reads its rally points."""
    await here.until("title", name)
    await here.wait(lambda: has_begun(here, name) and autopilot(here, name).home_geo is not None)
    await here.go("4")
    await here.until("map", name)
    await here.press("y")
    desk = here.app.desk.services.vehicle(name)
    await here.wait(lambda: desk.plans.rally == ())
    return desk


@pytest.mark.parametrize("style", sorted(VEHICLES))
async def test_rally_points_are_set_dragged_uploaded_and_read_back_and_home_is_moved(
    style: str, tmp_path: Path
) -> None:
    name, _, _ = VEHICLES[style]
    async with terminal(style, tmp_path) as here:
        desk = await begin(here, name)
        await here.press("right", "right", "i", "plus", "plus", "up", "up", "up", "i")
        await here.until("vehicles", "rally point 2: 22 m")
        await here.until("vehicles", "not uploaded")
        assert desk.plans.rally == (), "nothing is sent before it is asked for"
        edit, projection = shown_map(here).rally_edit, shown_map(here)._projection
        assert edit.points is not None
        handles = edit.state.places.handles if edit.state.places is not None else ()
        x, y = projection.dot(*handles[1].position_ne_m)
        gutter = shown_map(here).query_one("#map").gutter
        start = int(x // 2) + gutter.left, int(y // 4) + gutter.top
        await here.pilot.mouse_down("#map", offset=start)
        await here.pilot.hover("#map", offset=(start[0] - 8, start[1]))
        await here.pilot.mouse_up("#map", offset=(start[0] - 8, start[1]))
        first, second = edit.points
        assert second[1] < first[1], "it was dragged to the west"
        await here.press("delete")
        await here.wait(lambda: edit.points == (first,))
        await here.press("ctrl+z", "plus")
        await here.wait(lambda: edit.points == (first, second))
        await here.press("ctrl+s")
        await here.until("vehicles", "on the vehicle")
        await here.wait(lambda: "2 rally points on the vehicle, read back and compared" in events(here))
        found = (await desk.services.plans.download()).plan.rally
        assert found == tuple(pytest.approx(point, abs=1e-6) for point in (first, second))
        await here.press("escape", "escape")
        await here.until("signs", "rally point")
        before = autopilot(here, name).home_geo
        await here.press("H")
        await here.wait(lambda: isinstance(here.app.screen, TextQuestion) and isinstance(here.app.focused, Input))
        await here.enter()
        await here.wait(lambda: isinstance(here.app.screen, YesNoQuestion))
        assert autopilot(here, name).home_geo == before, "home stays until it is confirmed"
        await here.press("y")
        await here.wait(lambda: "accepted by the autopilot, and read back" in events(here))
        await here.wait(lambda: autopilot(here, name).home_geo != before)
        with pytest.raises(Refused, match="is no place on Earth"):
            await here.app.desk.autopilots.set_home(name, GeoPoint(47.0, 8.0, 20_000.0))


async def test_home_and_rally_points_of_a_companions_vehicle_need_control() -> None:
    async with scene(plan=None, size=(120, 40)) as here:
        await flown_on_the_map(here, 5.0)
        await here.press("H")
        await here.wait(lambda: "set home: " in events(here))
        assert "is in control of heron; request control" in events(here)
        await here.press("y")
        await here.wait(lambda: "edit: this station has no link to heron" in events(here))
        assert not shown_map(here).edit.is_on
