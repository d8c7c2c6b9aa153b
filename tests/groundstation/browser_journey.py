"""An operator's journey in a headless Chromium, with three real processes: for the test, and for the page of evidence."""

import asyncio
import re
import signal
import time
from pathlib import Path
from typing import NamedTuple

from tests.commands.programs import program

from .chromium import Browser, chromium
from .real_terminal import real_vehicle

IS_LOST = "getComputedStyle(document.getElementById('banner')).display == 'flex'"
"""Whether the page says that the station does not answer."""


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
    await browser.press("3")
    await press(browser, "o", "open a mission")
    await browser.press(*"hop", "enter")
    await browser.until("open: hop.yaml")
    await press(browser, "s", "It arms and starts moving.")
    await press(browser, "y", "ARMED")
    await press(browser, "f5", "last 1 min")
    await asyncio.sleep(2.0)
    picture = await browser.picture()
    await browser.open(url)
    await browser.until("last 1 min")
    await press(browser, "1", "armed, in air")
    await press(browser, " ", "emergency hold")
    await press(browser, " ", "land here")
    await press(browser, "l", "emergency land")
    await browser.until("disarmed")
    await browser.press("q")
    return picture


async def press(browser: Browser, key: str, text: str) -> None:
    """Presses a key until the terminal shows a text: again where the page says that it was not sent, or came too late."""
    for _ in range(5):
        await browser.evaluate("document.getElementById('remark').textContent = ''")
        await browser.press(key)
        for _ in range(600):
            if text in browser.terminal.text():
                return
            if str(await browser.evaluate("document.getElementById('remark').textContent")).startswith("NOT "):
                break
            await asyncio.sleep(0.05)
    raise AssertionError(f"never came: {text}\n{browser.terminal.text()}")


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
            await browser.until_shown(IS_LOST, 3.0)
        received = browser.received_bytes
        elapsed_s = time.monotonic() - begin_s
        return Flown(url, code, station.text, picture, browser.requested, browser.problems, received, elapsed_s)


class Frozen(NamedTuple):
    """What the page of a station that stood still has shown."""

    lost_s: float
    """From the standstill to the banner."""
    back_s: float
    """From its end to a page that shows the station again."""
    remark: str
    """About the button HOLD, pressed meanwhile."""
    picture: bytes
    terminal: str
    """What it shows in the end."""
    problems: list[str]


async def freeze(folder: Path, still_s: float) -> Frozen:
    """Stops a station as its process, presses keys, and lets it go on."""
    options = ("--link", "udpin://127.0.0.1:0", "--no-record", "--config", "station.toml")
    with program("station", "--web", "--web-port", "0", *options, folder=folder) as station:
        line = await asyncio.to_thread(station.await_line, lambda line: "the station is at" in line)
        async with chromium(folder / "browser", 390, 844) as browser:
            await browser.emulate(390, 844, is_touch=True)
            await browser.open(line.split()[4])
            await browser.until("Waiting for a platform")
            station.process.send_signal(signal.SIGSTOP)
            try:
                await browser.press("2")
                lost_s = await browser.until_shown(IS_LOST, 10.0)
                await browser.tap("#touch .hold")
                remark = await browser.evaluate("document.getElementById('remark').textContent")
                picture = await browser.picture()
                await asyncio.sleep(still_s - lost_s)
            finally:
                station.process.send_signal(signal.SIGCONT)
            back_s = await browser.until_shown(f"!({IS_LOST})", 10.0)
            await browser.until("Waiting for a platform")
            problems = browser.problems
        return Frozen(lost_s, back_s, remark, picture, browser.terminal.text(), problems)
