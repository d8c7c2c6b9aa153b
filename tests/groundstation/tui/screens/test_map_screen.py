"""The map in the terminal: keys and mouse move it, it follows calmly, and it draws no more than has changed."""

import zlib

import pytest
from tests.groundstation.flown import Flight, flown_on_the_map
from tests.groundstation.looked_at import TOPICS, Viewer
from tests.groundstation.scripted_platform import ScriptedPlatform
from tests.groundstation.station_scene import Scene, scene

from gloc3.messages.command_interface import ReadMission, Watch
from gloc3.messages.perception import OccupancyMap
from gloc3.messages.vehicle import ObstacleScan
from gloc3.messages.watch import TopicEntry
from gloc3_groundstation.mapping.projection import Projection
from gloc3_groundstation.tui.screens.map import WATCHED, MapScreen
from gloc3_groundstation.tui.widgets.canvas_panel import CanvasPanel

pytestmark = pytest.mark.sockets


def shown_map(here: Scene) -> MapScreen:
    assert isinstance(here.app.base, MapScreen)
    return here.app.base


def seen(here: Scene) -> Projection:
    return shown_map(here)._projection


async def test_the_map_is_moved_by_keys_and_fitted_again() -> None:
    async with scene(plan=None, size=(120, 40)) as here:
        await flown_on_the_map(here, 30.0)
        await here.wait(lambda: "cargo hold inspection" in str(shown_map(here).query_one("#map").border_title))
        assert here.requested(ReadMission)
        await here.until("map", "5")
        await here.still("map")
        fitted = seen(here)
        await here.press("plus", "plus")
        await here.wait(lambda: seen(here).m_per_dot == pytest.approx(fitted.m_per_dot / 2.0))
        await here.press("l", "up")
        await here.wait(lambda: seen(here).east_m > fitted.east_m and seen(here).north_m > fitted.north_m)
        await here.press("o")
        await here.wait(lambda: seen(here).up_deg == 270.0)
        await here.until("map", "→ N")
        await here.press("o", "o", "o", "z")
        await here.wait(lambda: seen(here) == fitted)
        await here.until("cursor", "from heron")
        kind = here.shown("profile")
        await here.press("d")
        await here.wait(lambda: here.shown("profile") != kind and "-5 min" in here.shown("profile"))
        await here.press("d")
        await here.wait(lambda: not shown_map(here).query_one("#profile").display)


async def test_a_map_that_follows_stands_still_until_the_vehicle_is_far_from_its_middle() -> None:
    async with scene(plan=None) as here:
        flight = await flown_on_the_map(here, 5.0)
        await here.press("plus", "plus", "plus", "f")
        await here.wait(lambda: shown_map(here)._is_following)
        here.app.show_fleet()
        begun, middles = seen(here), set()
        for n in range(40):
            flight.move(100.0 + n / 4.0, (0.25 * n, 0.0, -2.0), (1.0, 0.0, 0.0), 0.0)
            flight.now_s += 0.25
            here.app.show_fleet()
            middles.add((seen(here).north_m, seen(here).east_m))
        assert 1 < len(middles) <= 8
        assert seen(here).m_per_dot == begun.m_per_dot
        await here.press("left")
        await here.wait(lambda: not shown_map(here)._is_following)


async def test_obstacles_and_map_are_asked_for_only_while_the_map_is_shown_and_of_a_vehicle_that_has_them() -> None:
    async with scene(plan=None) as here:
        viewer = Viewer(here.exchange, here.platform)
        scanner = [("obstacles", "ObstacleScan", 5.0, "scanner"), ("map", "OccupancyMap", 1.0, "map")]
        here.platform.topics = [*TOPICS, *(TopicEntry(*one) for one in scanner)]
        other = ScriptedPlatform(here.exchange, "stork", 8)
        other.topics = TOPICS
        flight = Flight(here)
        flight.begin()
        flight.fly(5.0)
        await here.until("title", "heron")
        assert here.platform.watched == Watch()
        await here.go("4")
        await here.wait(lambda: here.platform.watched.wants == sorted(WATCHED, key=lambda want: want.topic))
        viewer.show("obstacles", ObstacleScan(points_ne_m=[(2.0, 2.0), (2.0, -2.0)]), 1.0)
        await here.wait(lambda: (heron := here.station.fleet.get("heron")) is not None and heron.obstacles is not None)
        cells = zlib.compress(bytes([2]))
        known = OccupancyMap(
            corner_ne_m=(0.0, 0.0), cell_m=0.1, rows=1, columns=1, layer_m=0.5, levels=[0], cells=cells
        )
        viewer.show("map", known, 1.0)
        await here.wait(lambda: (heron := here.station.fleet.get("heron")) is not None and heron.map is not None)
        await here.go("1")
        await here.wait(lambda: here.platform.watched == Watch())
        other.speak()
        await here.until("title", "1/2")
        await here.press("v")
        await here.go("4")
        await here.wait(lambda: bool(here.station.monitor.watches.entries("stork")))
        here.app.show_fleet()
        assert (here.platform.watched, other.watched) == (Watch(), Watch())


async def test_the_mouse_is_the_cursor() -> None:
    async with scene(plan=None) as here:
        await flown_on_the_map(here, 5.0)
        before = here.shown("cursor")
        await here.pilot.hover("#map", offset=(10, 5))
        await here.wait(lambda: here.shown("cursor") != before)


async def test_of_a_line_that_changes_only_the_columns_that_differ_are_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    async with scene(plan=None) as here:
        flight = await flown_on_the_map(here, 20.0)
        panel = shown_map(here).query_one("#map", CanvasPanel)
        await here.still("map")
        drawn: list[int] = []
        monkeypatch.setattr(panel, "refresh", lambda *regions, **_: drawn.extend(region.area for region in regions))
        here.app.show_fleet()
        assert drawn == []
        flight.move(100.0, (4.0, 1.0, -2.0), (1.0, 0.0, 0.0), 0.0)
        here.app.show_fleet()
        assert 0 < sum(drawn) < panel.size.area / 4


async def test_charts_are_frozen_taken_back_in_time_and_let_go() -> None:
    async with scene(plan=None) as here:
        flight = Flight(here)
        flight.begin()
        flight.fly(50.0)
        await here.go("5")
        await here.until("charts", "height")
        await here.until("attitude", "°")

        def title() -> str:
            here.app.show_fleet()
            assert here.app.base is not None
            return str(here.app.base.query_one("#charts", CanvasPanel).border_title)

        assert title() == "last 1 min"
        await here.press("minus")
        await here.wait(lambda: title() == "last 2 min")
        await here.press("f")
        await here.wait(lambda: title() == "2 min, FROZEN 0 s ago")
        frozen = here.shown("charts")
        flight.now_s += 12.0
        flight.move(80.0, (4.0, 1.0, -5.0), (1.0, 0.0, 0.0), 0.0)
        assert title() == "2 min, FROZEN 12 s ago"
        assert here.shown("charts").splitlines()[:-1] == frozen.splitlines()[:-1]
        await here.until("attitude", "wanted 5.00")
        await here.press("left")
        await here.wait(lambda: title() == "2 min, FROZEN 42 s ago")
        await here.press("z")
        await here.wait(lambda: title() == "last 2 min")
        await here.press("down", "down")
        await here.wait(lambda: "height" not in here.shown("charts"))
