"""The page of pictures: a camera's colours as a picture, for who may see it, and nothing requested without it."""

import asyncio
import base64
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from tests.groundstation.chromium import chromium, found
from tests.groundstation.looked_at import TOPICS, Viewer
from tests.groundstation.web.test_access import cookie_of, fetch
from tests.groundstation.web.test_web import Page, Served, emergencies, served, status_of
from websockets.exceptions import InvalidStatus

from gloc3.messages.vehicle import Image
from gloc3.messages.watch import Preview, Want
from gloc3_groundstation.web.access import new_token
from gloc3_groundstation.web.server import WebOptions
from gloc3_onboard.viewer.viewer import load_shrinker

pytestmark = pytest.mark.sockets

GROUND = "camera/ground"
ORANGE_BGR, BLUE_BGR = (20, 120, 240), (200, 60, 10)


def colourful(width: int = 64, height: int = 48) -> Preview:
    """What the vehicle makes of a picture whose left half is orange, and whose right half is blue."""
    pixels = np.full((480, 640, 3), ORANGE_BGR, np.uint8)
    pixels[:, 320:] = BLUE_BGR
    grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    image = Image(camera="ground", width=640, height=480, data=grey.tobytes(), bgr=pixels.tobytes())
    return load_shrinker()(image, width, height, 60)


def viewer(here: Served) -> Viewer:
    return Viewer(here.exchange, here.platform)


async def state(page: Page, **wanted: object) -> dict[str, Any]:
    """The first state of the page that has certain values."""
    while True:
        (found_state,) = await page.message("cameras")
        if wanted.items() <= found_state.items():
            return dict(found_state)


async def shown(here: Served, page: Page, sight: Viewer) -> tuple[str, str, str, Any]:
    """Shows a picture, once it is watched; what the page gets."""
    await page.wait(lambda: bool(here.platform.watched.wants), "the picture is requested")
    want = here.platform.watched.wants[0]
    sight.show(want.topic, colourful(want.width, want.height), 1.0, 2.0)
    vehicle, camera, size, data = await page.message("picture")
    pixels = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
    return vehicle, camera, size, pixels


async def test_a_page_gets_the_picture_in_colour_while_it_is_open_and_no_longer() -> None:
    async with served() as here:
        sight = viewer(here)
        async with here.page(path="pictures/ws") as page:
            await page.report("room", 320, 240)
            await state(
                page, selected="heron", camera=GROUND, cameras=[GROUND], problem="waiting for the first picture"
            )
            vehicle, camera, size, pixels = await shown(here, page, sight)
            assert (vehicle, camera, size) == ("heron", GROUND, "64 × 48 of 640 × 480")
            assert pixels.shape == (48, 64, 3)
            assert np.abs(pixels[24, 10].astype(int) - ORANGE_BGR).max() < 12
            assert np.abs(pixels[24, 54].astype(int) - BLUE_BGR).max() < 12
            assert (await state(page, problem=""))["age_s"] < 5.0
            assert here.platform.watched.wants == [Want(GROUND, 1.0, 64, 48, 60)]
        await page_is_gone(here)


async def page_is_gone(here: Served) -> None:
    async with asyncio.timeout(10.0):
        while here.platform.watched.wants:
            await asyncio.sleep(0.05)


async def test_it_says_why_there_is_no_picture() -> None:
    async with served() as here:
        here.platform.topics = [one for one in TOPICS if one.type != "Image"]
        async with here.page(path="pictures/ws") as page:
            await state(page, problem="it has no camera", cameras=[])
            assert here.platform.watched.wants == []
    async with served() as here:
        sight = viewer(here)
        async with here.page(path="pictures/ws") as page:
            await page.wait(lambda: bool(here.platform.watched.wants), "the picture is requested")
            broken = Preview(
                camera="ground",
                width=0,
                height=0,
                full_width=640,
                full_height=480,
                data=b"",
                is_valid=False,
                reason="dark",
            )
            sight.show(GROUND, broken, 1.0)
            await state(page, problem="dark")


async def test_only_a_token_opens_it_and_a_read_only_page_does_not_hold() -> None:
    async with served(WebOptions(port=0, token=new_token())) as here:
        assert await status_of(f"{here.url}pictures") == 403
        with pytest.raises(InvalidStatus, match="403"):
            async with here.page(path="pictures/ws"):
                raise AssertionError("it was opened without a token")
        watch, command = [await cookie_of(here, url) for url in (here.addresses.watch, here.addresses.command)]
        served_page = await fetch(f"{here.url}pictures", cookie=watch)
        assert served_page.status == 200
        assert "img-src 'self' data:" in served_page.headers["Content-Security-Policy"]
        async with here.page(path="pictures/ws", cookie=watch) as reader:
            await state(reader, selected="heron")
            await reader.report("hold", "heron", reader.beat_ms)
            await reader.message("read_only")
            assert not emergencies(here)
        async with here.page(path="pictures/ws", cookie=command) as page:
            await page.report("hold", "heron", page.beat_ms)
            assert (await page.message("result"))[0] is True
            assert len(emergencies(here)) == 1


@pytest.mark.skipif(found() is None, reason="no Chromium on PATH: apt-get install chromium")
async def test_chromium_shows_the_colours(tmp_path: Path) -> None:
    async with served() as here, chromium(tmp_path, 390, 844) as browser:
        sight = viewer(here)
        await browser.emulate(390, 844, is_touch=True)
        await browser.open(f"{here.url}pictures")
        while not here.platform.watched.wants:
            await asyncio.sleep(0.05)
        sight.show(GROUND, colourful(320, 240), 1.0, 2.0)
        await browser.until_shown("document.getElementById('picture').naturalWidth == 320")
        left, right = await browser.evaluate(
            "(() => { const canvas = document.createElement('canvas'); canvas.width = 320; canvas.height = 240;"
            "const pen = canvas.getContext('2d'); pen.drawImage(document.getElementById('picture'), 0, 0);"
            "return [80, 240].map((x) => [...pen.getImageData(x, 120, 1, 1).data].slice(0, 3)); })()"
        )
        assert np.abs(np.subtract(left, ORANGE_BGR[::-1])).max() < 12
        assert np.abs(np.subtract(right, BLUE_BGR[::-1])).max() < 12
        assert await browser.evaluate(
            "(({ top, bottom, height }) => top >= 0 && bottom <= innerHeight && height >= 44)"
            "(document.getElementById('hold').getBoundingClientRect())"
        )
        assert browser.problems == []
