"""An operator's journey in a headless Chromium, with three real processes: for the test, and for the page of evidence."""

import asyncio
import re
import time
from pathlib import Path
from typing import NamedTuple

from tests.commands.programs import program

from .chromium import Browser, chromium
from .real_terminal import real_vehicle

MESSAGE_IS_SHOWN = "getComputedStyle(document.querySelector('.message')).display == 'flex'"


class Flown(NamedTuple):
    """What came of it."""

    url: str
    code: int
    """The station's exit code."""
    reported: str
    """What the station has said in its terminal."""
    picture: bytes
    """What the browser shows in flight, as PNG."""
    requested: list[str]
    """The addresses of everything that the page has asked for."""
    problems: list[str]
    """What went wrong in the page."""
    received_bytes: int
    took_s: float


async def journey(browser: Browser, url: str) -> bytes:
    """Opens the hop, starts it, loads the page anew in flight, holds, lands, quits; gives a picture taken in flight."""
    await browser.open(url)
    await browser.wait(lambda: re.search(r"health +all \d+ well", browser.terminal.text()) is not None, what="all work")
    await browser.press("3", "o")
    await browser.until("open a mission")
    await browser.press(*"hop", "enter")
    await browser.until("open: hop.yaml")
    await browser.press("s")
    await browser.until("It arms and starts moving.")
    await browser.press("y")
    await browser.until("ARMED")
    await browser.press("f5")
    await browser.until("last 1 min")
    await asyncio.sleep(2.0)
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


async def fly(folder: Path) -> Flown:
    """Starts everything, flies, and waits until the page says that the station has gone."""
    begin_s = time.monotonic()
    with (
        real_vehicle(folder) as (link, _, _),
        program("station", "--web", "--web-port", "0", "--link", link, "--no-record", folder=folder) as station,
    ):
        line = await asyncio.to_thread(station.await_line, lambda line: "the station is at" in line)
        url = line.split()[4]
        async with chromium(folder / "browser") as browser:
            picture = await journey(browser, url)
            code = await asyncio.to_thread(station.end)
            async with asyncio.timeout(10.0):
                while not await browser.evaluate(MESSAGE_IS_SHOWN):
                    await asyncio.sleep(0.05)
        received = browser.received_bytes
        elapsed_s = time.monotonic() - begin_s
        return Flown(url, code, station.text, picture, browser.requested, browser.problems, received, elapsed_s)
