"""An operator in a headless Chromium: a flight, and a station that stands still.

Where none is installed this is skipped; what needs none, the page and its websocket, is tested in `test_web.py`.
"""

from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from tests.groundstation.browser_bars import HOLD, LAST_LINE, SIZES, ScreenSize, browsing
from tests.groundstation.browser_journey import fly, freeze
from tests.groundstation.chromium import found
from tests.groundstation.web.test_web import served

pytestmark = [
    pytest.mark.sockets,
    pytest.mark.flight,
    pytest.mark.skipif(found() is None, reason="no Chromium on PATH: apt-get install chromium"),
]


@pytest.mark.parametrize("size", SIZES, ids=str)
async def test_hold_and_the_last_line_of_the_terminal_are_on_the_screen(size: ScreenSize, tmp_path: Path) -> None:
    async with served() as here, browsing(tmp_path, size) as browser:
        await browser.open(here.url)
        await browser.until("space HOLD")
        assert await browser.evaluate(LAST_LINE)
        button = await browser.evaluate(HOLD)
        assert button is not None
        assert button["isWhole"]
        assert min(button["width"], button["height"]) >= 44.0


async def test_an_operator_flies_in_a_browser(tmp_path: Path) -> None:
    flown = await fly(tmp_path)
    assert flown.code == 0, flown.reported
    assert "'hop' is aborted" in flown.reported
    pixels = cv2.imdecode(np.frombuffer(flown.picture, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 100, "letters with soft edges, a horizon, charts"
    assert {urlsplit(requested).netloc for requested in flown.requested} == {urlsplit(flown.url).netloc}, (
        "nothing from elsewhere"
    )
    assert flown.problems == []


async def test_a_station_that_stands_still_is_reported_by_the_page_within_3_s_and_comes_back(tmp_path: Path) -> None:
    frozen = await freeze(tmp_path, still_s=7.0)
    assert frozen.lost_s < 3.0
    assert frozen.remark == "HOLD NOT SENT: the station does not answer."
    assert frozen.back_s < 6.0, "the longest back-off, and the time to connect"
    assert "the data flows from end to end" not in frozen.terminal, "a key that was pressed as it stopped"
    assert frozen.problems == []
