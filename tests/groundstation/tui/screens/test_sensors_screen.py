"""The sensors screen: it asks for what is under the cursor, shows it, and for nothing more when it is left."""

import pytest
from tests.groundstation.looked_at import Viewer
from tests.groundstation.scripted_platform import ScriptedPlatform
from tests.groundstation.station_scene import Scene, scene

from gloc3.messages.command_interface import Watch
from gloc3.messages.vehicle import ObstacleScan
from gloc3_groundstation.tui.widgets.panel import ListPanel
from gloc3_groundstation.tui.widgets.picture_panel import PicturePanel

pytestmark = pytest.mark.sockets


def watched(here: Scene) -> list[str]:
    return [want.topic for want in here.platform.watched.wants]


async def look_at(here: Scene, topic: str) -> None:
    """Moves the cursor to a topic and waits until it is asked for."""
    await here.until("topics", topic)
    here.app.screen.query_one("#topics", ListPanel).point_at(topic)
    await here.wait(lambda: watched(here) == [topic])


async def test_the_topic_under_the_cursor_is_asked_for_shown_and_plotted_and_left_alone_afterwards() -> None:
    async with scene(size=(120, 40)) as here:
        viewer = Viewer(here.exchange, here.platform)
        here.platform.speak()
        await here.go("7")
        await look_at(here, "pose")
        assert here.platform.watched.is_listing
        viewer.tell_activity()
        viewer.fly(20.0)
        await here.until("fields", "position ned")
        await here.until("topics", "20.0")
        await here.until("sight", "publishes 20.0 Hz")
        here.app.screen.query_one("#fields", ListPanel).point_at("position_ned_m")
        await here.until("plot", "x")
        assert "4.000" in here.shown("plot")
        await here.go("1")
        await here.wait(lambda: here.platform.watched == Watch())


async def test_a_camera_is_shown_as_a_picture_at_a_size_that_the_link_affords() -> None:
    async with scene(size=(120, 40)) as here:
        viewer = Viewer(here.exchange, here.platform)
        here.platform.speak()
        await here.go("7")
        await look_at(here, "camera/ground")
        (want,) = here.platform.watched.wants
        assert (want.width, want.height, want.rate_hz) == (64, 48, 1.0)
        viewer.fly(1.0)
        panel = here.app.screen.query_one(PicturePanel)
        await here.wait(lambda: panel.picture is not None)
        assert panel.picture is not None
        assert panel.picture.width <= panel.room[0]
        assert panel.picture.height <= panel.room[1]
        assert panel.border_title == "ground: 64×48 of 640×480"


async def test_topics_are_found_while_one_types_and_the_rate_is_changed_by_a_key() -> None:
    async with scene() as here:
        Viewer(here.exchange, here.platform)
        here.platform.speak()
        await here.go("7")
        await here.until("topics", "autopilot")
        await type_name(here, "intern")
        await here.wait(lambda: "autopilot" not in here.shown("topics"))
        assert "components/pose" in here.shown("topics")
        await here.press("escape")
        await here.until("topics", "autopilot")
        await here.wait(lambda: bool(here.platform.watched.wants))
        assert here.platform.watched.wants[0].rate_hz == 5.0
        await here.press("minus")
        await here.wait(lambda: here.platform.watched.wants[0].rate_hz == 2.0)


async def type_name(here: Scene, name: str) -> None:
    """Types a topic's name once the field takes keys."""
    await here.press("slash")
    await here.types(name)
    await here.enter()


async def test_a_topic_that_is_not_listed_is_asked_for_by_its_name_and_a_wrong_one_is_refused_in_words() -> None:
    async with scene() as here:
        viewer = Viewer(here.exchange, here.platform)
        here.platform.speak()
        await here.go("7")
        await here.until("topics", "autopilot")
        await type_name(here, "nothing")
        await here.wait(lambda: watched(here) == ["nothing"])
        await here.until("sight", "there is no such topic")
        await here.press("escape")
        await type_name(here, "obstacles")
        await here.wait(lambda: watched(here) == ["obstacles"])
        scan = ObstacleScan(points_ne_m=[(0.0, 0.0), (4.0, 3.0), (4.0, -3.0)])
        viewer.show("obstacles", scan, 1.0)
        await here.until("plot", "3 points, 6.0 × 4.0 m")


async def test_leaving_the_vehicle_leaves_its_topics_too() -> None:
    async with scene() as here:
        Viewer(here.exchange, here.platform)
        other = ScriptedPlatform(here.exchange, "egret", 8)
        here.platform.speak()
        other.speak()
        await here.go("7")
        await here.wait(lambda: bool(here.platform.watched.wants))
        await here.press("v")
        await here.wait(lambda: here.platform.watched == Watch() and other.watched.is_listing)
