"""The map page: what it is sent, and commands with the terminal's desk, checks, question and rights."""

from pathlib import Path
from typing import Any

import pytest
from tests.groundstation.web.test_access import cookie_of, fetch
from tests.groundstation.web.test_tiles import PICTURE, mbtiles
from tests.groundstation.web.test_web import Page, Served, emergencies, served, status_of

from gloc3.messages.command_interface import RequestAction
from gloc3.messages.motion import MotionSummary, SiteSummary
from gloc3_groundstation.mapping.ground import Ground
from gloc3_groundstation.mapping.tracks import Track, Tracks
from gloc3_groundstation.station.snapshots import PlatformSnapshot
from gloc3_groundstation.web.access import new_token
from gloc3_groundstation.web.map_data import TrailFeed
from gloc3_groundstation.web.server import WebOptions
from gloc3_groundstation.web.tiles import open_tiles

SITE = SiteSummary(frame="", x_axis_bearing_deg=0.0, origin_geo=(43.1, 9.2, 12.0), home_m=(0.0, 0.0, 0.0))


def motion(t_s: float, north_m: float, east_m: float) -> MotionSummary:
    return MotionSummary(
        t_s=t_s,
        attitude_cdeg=(0, 0, 9_000),
        position_cm=(round(100 * north_m), round(-100 * east_m), 250),
        velocity_cm_s=(0, 0, 0),
        is_pose_valid=True,
    )


def on_the_map(here: Served) -> None:
    here.platform.report("site", SITE)
    here.platform.report("motion", motion(here.platform.loop.time(), 3.0, 4.0))
    here.platform.fly(is_armed=True, position_m=(3.0, -4.0, 2.5), geo=(43.1, 9.2, 14.5), frame="")


async def picture_with_place(page: Page) -> dict[str, Any]:
    while True:
        (picture,) = await page.message("map")
        if picture["vehicles"] and picture["vehicles"][0]["place"] == [3.0, 4.0]:
            return dict(picture)


def actions(here: Served) -> list[RequestAction]:
    return [body for body in here.platform.requests if isinstance(body, RequestAction)]


@pytest.mark.sockets
async def test_the_map_has_the_vehicle_its_home_and_its_trail() -> None:
    async with served() as here, here.page(path="map/ws") as page:
        on_the_map(here)
        picture = await picture_with_place(page)
        (vehicle,) = picture["vehicles"]
        assert picture["selected"] == vehicle["name"] == "heron"
        assert picture["origin"] == pytest.approx([43.1, 9.2, 12.0])
        assert vehicle["place"] == [3.0, 4.0]
        assert (vehicle["height_m"], vehicle["heading_deg"], vehicle["is_armed"]) == (2.5, 90.0, True)
        here.platform.fly(heading_deg=-1)
        while (await page.message("map"))[0]["vehicles"][0]["heading_deg"] is not None:
            pass
        while (plan := (await page.message("plan"))[0])["home"] is None:
            pass
        assert plan["home"] == [0.0, 0.0]
        while (await page.message("trails"))[0]["heron"]["points"][-1] != [3.0, 4.0]:
            pass


@pytest.mark.sockets
async def test_going_to_a_place_asks_first_and_requests_what_was_confirmed() -> None:
    async with served() as here, here.page(path="map/ws") as page:
        on_the_map(here)
        key = (await picture_with_place(page))["key"]
        await page.report("go_to", "heron", key, 13.0, 4.0, page.beat_ms)
        (question,) = await page.message("question")
        assert "10 m away, bearing 000°" in question["text"]
        assert question["height_m"] == 2.5
        assert actions(here) == [], "not before the answer"
        await page.report("confirm", "another", 5.0, page.beat_ms)
        assert (await page.message("result"))[0] is False
        await page.report("go_to", "heron", key, 13.0, 4.0, page.beat_ms)
        (question,) = await page.message("question")
        await page.report("confirm", question["number"], 5.0, page.beat_ms)
        is_done, text = await page.message("result")
        assert is_done, text
        (action,) = actions(here)
        assert action.capability == "go_to"
        place = action.arguments.get("position") or action.arguments["position_m"]
        assert place[2] == 5.0
        await page.report("confirm", question["number"], 5.0, page.beat_ms)
        assert (await page.message("result"))[0] is False, "a question is answered once"
        assert len(actions(here)) == 1


@pytest.mark.sockets
@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (("go_to", "heron", "another plane", 1.0, 1.0), "choose the place again"),
        (("go_to", "nobody", "", 1.0, 1.0), "nobody is not known"),
        (("hold", "nobody"), "no vehicle"),
    ],
)
async def test_what_cannot_be_done_is_refused_with_the_reason(message: tuple[object, ...], reason: str) -> None:
    async with served() as here, here.page(path="map/ws") as page:
        on_the_map(here)
        await picture_with_place(page)
        await page.report(*message, page.beat_ms)
        is_done, text = await page.message("result")
        assert not is_done
        assert reason in text


@pytest.mark.sockets
async def test_hold_on_the_map_holds_and_a_late_or_read_only_one_does_not() -> None:
    async with served(WebOptions(port=0, token=new_token())) as here:
        watch, command = [await cookie_of(here, url) for url in (here.addresses.watch, here.addresses.command)]
        async with here.page(path="map/ws", cookie=watch) as reader, here.page(path="map/ws", cookie=command) as page:
            on_the_map(here)
            key = (await picture_with_place(reader))["key"]
            await reader.report("hold", "heron", reader.beat_ms)
            await reader.message("read_only")
            await reader.report("go_to", "heron", key, 1.0, 1.0, reader.beat_ms)
            await reader.message("read_only")
            await page.report("hold", "heron", page.beat_ms - 3100.0)
            await page.message("dropped")
            assert not emergencies(here)
            await page.report("hold", "heron", page.beat_ms)
            assert (await page.message("result"))[0] is True
            assert len(emergencies(here)) == 1


@pytest.mark.sockets
async def test_the_page_and_its_tiles_are_served_and_scripts_and_styles_come_from_the_station_alone(
    tmp_path: Path,
) -> None:
    async with served(WebOptions(port=0, tiles=open_tiles(str(mbtiles(tmp_path / "map"))))) as here:
        page = await fetch(f"{here.url}map")
        assert page.status == 200
        assert "style-src 'self';" in page.headers["Content-Security-Policy"]
        assert "style=" not in page.text
        tile = await fetch(f"{here.url}tiles/3/5/2")
        assert (tile.status, tile.headers["Content-Type"]) == (200, "image/png")
        assert PICTURE[1:].decode() in tile.text
        for wrong in ("3/5/3", "3/9/0", "99/0/0", "3/-1/0"):
            assert await status_of(f"{here.url}tiles/{wrong}") == 404
        async with here.page(path="map/ws") as map_page:
            (hello,) = await map_page.message("hello")
            assert hello["tiles"] == {"least_zoom": 3, "most_zoom": 3, "attribution": "© Mapmakers"}
    async with served() as here:
        assert await status_of(f"{here.url}tiles/3/5/2") == 404


def test_a_trail_is_sent_once_with_its_gaps_and_as_a_whole_after_it_was_cleared() -> None:
    tracks = Tracks()
    track = tracks._tracks["heron"] = Track()
    platform = PlatformSnapshot(name="heron", boot=1, first_received_s=0.0, received_s=0.0)
    feed, ground = TrailFeed(tracks), Ground(platform)
    for t_s in (1.0, 2.0):
        track.trail.add(t_s, (t_s, 0.0, 0.0))
    first = feed.new(ground, [platform])
    assert first == {"heron": {"is_new": True, "points": [(1.0, 0.0), (2.0, 0.0)]}}
    assert feed.new(ground, [platform]) is None
    track.trail.interrupt()
    track.trail.add(9.0, (9.0, 0.0, 0.0))
    assert feed.new(ground, [platform]) == {"heron": {"is_new": False, "points": [None, (9.0, 0.0)]}}
    track.trail.clear()
    track.trail.add(10.0, (0.0, 0.0, 0.0))
    again = feed.new(ground, [platform])
    assert again == {"heron": {"is_new": True, "points": [(0.0, 0.0)]}}
