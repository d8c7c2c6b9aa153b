"""An operator's journey in a headless Chromium, with three real processes.

Where no Chromium is installed it is skipped; what needs none, the page and its websocket, is tested in `test_web.py`.
"""

import asyncio
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from tests.commands.programs import program

from .chromium import Browser, chromium, found
from .real_terminal import real_vehicle

pytestmark = [pytest.mark.sockets, pytest.mark.flight]


async def journey(browser: Browser, url: str) -> bytes:
    """Opens the hop, starts it, loads the page anew in flight, holds, lands, quits; gives a picture taken in flight."""
    await browser.open(url)
    await browser.until("all 18 well")
    await browser.press("3", "o")
    await browser.until("open a mission")
    await browser.press(*"hop", "enter")
    await browser.until("at hand: hop.yaml")
    await browser.press("s")
    await browser.until("ARMED")
    await browser.press("f5")
    await browser.until("last 1 min")
    await asyncio.sleep(0.5)
    picture = await browser.picture()
    await browser.open(url)
    await browser.until("last 1 min")
    await browser.press("1")
    await browser.until("armed, in air")
    await browser.press(" ")
    await browser.until("emergency hold")
    await browser.press(" ")
    await browser.until("land here")
    await browser.press("l")
    await browser.until("emergency land")
    await browser.until("disarmed")
    await browser.press("q")
    return picture


@pytest.mark.skipif(found() is None, reason="no Chromium is installed here")
async def test_an_operator_flies_in_a_browser(tmp_path: Path) -> None:
    with (
        real_vehicle(tmp_path) as (link, _, _),
        program("station", "--web", "--web-port", "0", "--link", link, "--no-record", folder=tmp_path) as station,
    ):
        line = await asyncio.to_thread(station.await_line, lambda line: "the station is at" in line)
        url = line.split()[4]
        async with chromium(tmp_path / "browser") as browser:
            pixels = cv2.imdecode(np.frombuffer(await journey(browser, url), np.uint8), cv2.IMREAD_COLOR)
            assert await asyncio.to_thread(station.end) == 0, station.text
            async with asyncio.timeout(10.0):
                while not await browser.evaluate(
                    "getComputedStyle(document.querySelector('.message')).display == 'flex'"
                ):
                    await asyncio.sleep(0.05)
        assert pixels is not None
        assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 100, "letters with soft edges, a horizon, charts"
        assert {urlsplit(asked).netloc for asked in browser.requested} == {urlsplit(url).netloc}, (
            "nothing from elsewhere"
        )
        assert browser.problems == []
        assert "'hop' is aborted" in station.text
