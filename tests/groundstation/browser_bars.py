"""What the station's pages show in a headless Chromium, measured with real processes: for the page of evidence."""

import asyncio
import os
import re
import signal
import socket
import time
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from tests.benchmarks.terminal import loaded
from tests.commands.programs import Program, program

from .browser_journey import IS_LOST, press
from .chromium import Browser, chromium


class ScreenSize(NamedTuple):
    """A device."""

    width: int
    height: int
    is_touch: bool

    def __str__(self) -> str:
        return f"{self.width}×{self.height}{', touch' if self.is_touch else ''}"


SIZES = (ScreenSize(390, 844, True), ScreenSize(1280, 800, False), ScreenSize(1920, 1080, False))
PAGES = ("", "map", "pictures")
HOLD = """(() => {
  const found = [...document.querySelectorAll('.hold')].map((one) => [one, one.getBoundingClientRect()])
    .filter(([one, box]) => box.width > 0 && box.height > 0);
  const [one, box] = found.find(([one, { x, y, width, height }]) =>
    one.contains(document.elementFromPoint(x + width / 2, y + height / 2))) ?? [null, null];
  return one && { x: box.x + box.width / 2, y: box.y + box.height / 2, width: box.width, height: box.height,
    isWhole: box.left >= 0 && box.top >= 0 && box.right <= innerWidth && box.bottom <= innerHeight };
})()"""
"""Where a button HOLD is that nothing covers; null without one."""
LAST_LINE = """(() => {
  const { bottom } = document.querySelector('.xterm-screen').getBoundingClientRect();
  const { bottom: room } = document.querySelector('main').getBoundingClientRect();
  return bottom <= Math.min(room, innerHeight) + 0.5;
})()"""
"""Whether the last line of the terminal is on the screen."""
REMARK = "document.getElementById('remark').textContent"
VEHICLES, PARTS, RATE_HZ = 20, 20, 5.0
WARM_S, WATCH_S = 12.0, 10.0
TICKS = os.sysconf("SC_CLK_TCK")


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@contextmanager
def station(folder: Path, *options: str, port: int | None = None) -> Iterator[tuple[Program, str]]:
    """A station with its page, and the first address that it prints."""
    link = f"udpin://127.0.0.1:{port if port is not None else 0}"
    with program(
        "station", "--web", *options, "--link", link, "--no-record", "--config", "station.toml", folder=folder
    ) as running:
        yield running, address(running)


def address(running: Program, behind: int = 0) -> str:
    """The address that a station has printed."""
    line = running.await_line(lambda line: re.search(r"https?://\S+", line) is not None, behind=behind)
    found = re.search(r"https?://[^\s,;]+", line)
    assert found is not None
    return found[0]


@asynccontextmanager
async def browsing(folder: Path, size: ScreenSize = SIZES[1]) -> AsyncIterator[Browser]:
    """A browser of a size."""
    async with chromium(folder / "browser", size.width, size.height) as browser:
        await browser.emulate(size.width, size.height, is_touch=size.is_touch)
        yield browser


# --- HOLD ---


async def held(folder: Path, size: ScreenSize) -> list[dict[str, Any]]:
    """Presses HOLD on each page of a station with two vehicles; where it is, what came of it, and what is seen."""
    port, found = free_port(), []
    with station(folder, "--web-port", "0", port=port) as (_, url), loaded(port, 2, 5, 2.0):
        async with browsing(folder, size) as browser:
            for page in PAGES:
                await browser.open(url + page)
                if page:
                    await browser.until_shown("document.getElementById('hold').textContent.includes('vehicle_')")
                else:
                    await browser.until("vehicle_000")
                await asyncio.sleep(1.0)
                button = await browser.evaluate(HOLD)
                picture = await browser.picture()
                said = await pressed_hold(browser, size, button, page) if button is not None else "there is no HOLD"
                is_whole = bool(await browser.evaluate(LAST_LINE)) if not page else True
                row = {"page": page, "button": button, "said": said, "picture": picture.hex(), "is_whole": is_whole}
                found.append(row)
            assert browser.problems == [], browser.problems
    return found


async def pressed_hold(browser: Browser, size: ScreenSize, button: dict[str, float], page: str) -> str:
    """Presses the button by finger or mouse; what the page says."""
    if size.is_touch:
        place = {"x": button["x"], "y": button["y"]}
        await browser.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[place])
        await browser.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    else:
        await browser.click(button["x"], button["y"])
    if not page:
        await browser.until("emergency hold")
        return "emergency hold"
    await browser.until_shown(f"{REMARK} != ''")
    return str(await browser.evaluate(REMARK))


# --- a station that stands still, and one that is started again ---


async def frozen(folder: Path, size: ScreenSize, still_s: float = 6.0) -> dict[str, Any]:
    """Stops the station's process for a time."""
    with station(folder, "--web-port", "0") as (running, url):
        async with browsing(folder, size) as browser:
            await browser.open(url)
            await browser.until("Waiting for a platform")
            running.process.send_signal(signal.SIGSTOP)
            begin_s = time.monotonic()
            try:
                lost_s = await browser.until_shown(IS_LOST, 10.0)
                await asyncio.sleep(0.3)
                picture = await browser.picture()
                await asyncio.sleep(max(0.0, still_s - (time.monotonic() - begin_s)))
            finally:
                running.process.send_signal(signal.SIGCONT)
            back_s = await browser.until_shown(f"!({IS_LOST})", 10.0)
            await browser.until("Waiting for a platform")
            return {"lost_s": lost_s, "back_s": back_s, "picture": picture.hex(), "problems": browser.problems}


async def restarted(folder: Path) -> dict[str, Any]:
    """Ends the station, and starts it again with the same token and port."""
    options = ("--web-port", str(free_port()), "--web-token", "token")
    async with browsing(folder) as browser:
        with station(folder, *options) as (_, url):
            await browser.open(url)
            await browser.until("Waiting for a platform")
        lost_s = await browser.until_shown(IS_LOST, 10.0)
        with station(folder, *options):
            back_s = await browser.until_shown(f"!({IS_LOST})", 30.0)
            await browser.until("Waiting for a platform")
    return {"lost_s": lost_s, "back_s": back_s}


# --- several browsers, and who may what ---


async def two_browsers(folder: Path) -> dict[str, str]:
    """A second window, which takes the terminal over; and a map beside it."""
    with station(folder, "--web-port", "0") as (_, url):
        async with browsing(folder / "one") as one, browsing(folder / "two") as two:
            await one.open(url)
            await one.until("Waiting for a platform")
            await two.open(url)
            await two.until("The station is shown in another window.")
            await press(two, "enter", "Waiting for a platform")
            await one.until("The station is shown in another window.")
            await one.open(url + "map")
            await one.until_shown("document.getElementById('link').textContent == 'link ok'")
            await two.until("Waiting for a platform")
            return {
                "first": "shown in another window",
                "map": str(await one.evaluate("document.getElementById('link').textContent")),
            }


async def rights(folder: Path) -> dict[str, Any]:
    """A wrong token; the read-only address; the one that commands."""
    port = free_port()
    options = ("--web-host", "0.0.0.0", "--web-port", "0")
    with station(folder, *options, port=port) as (running, url), loaded(port, 1, 5, 2.0):
        await asyncio.to_thread(running.await_line, lambda line: line.startswith("the station is at"))
        addresses = [found.rstrip(",;") for found in re.findall(r"https?://\S+token=\S+", running.text)]
        host = re.match(r"https?://[^/]+", url)
        assert host is not None
        local = f"http://127.0.0.1:{host[0].rpartition(':')[2]}/"
        async with browsing(folder) as browser:
            await browser.open(f"{local}?token=wrong")
            await browser.until_shown("document.querySelector('h1') != null")
            title = await browser.evaluate("document.querySelector('h1').textContent")
            status = await browser.evaluate("performance.getEntriesByType('navigation')[0].responseStatus")
            watch = next(one for one in addresses if one != url)
            await browser.open(local + "?" + watch.partition("?")[2])
            await browser.until("vehicle_000")
            await browser.until("the page was refused to")
            lines = browser.terminal.text().splitlines()
            refused = next(line.strip() for line in lines if "the page was refused to" in line)
            role = await browser.evaluate("document.getElementById('role').textContent")
            await browser.press("2")
            button = await browser.evaluate(HOLD)
            await browser.click(button["x"], button["y"])
            await browser.until_shown(f"{REMARK} != ''")
            remark = await browser.evaluate(REMARK)
            await asyncio.sleep(1.0)
            is_held = "emergency hold" in browser.terminal.text()
    return {
        "title": title,
        "status": status,
        "refused": refused,
        "role": role,
        "remark": remark,
        "is_held": is_held,
        "addresses": len({*addresses}),
    }


async def encrypted(folder: Path) -> dict[str, Any]:
    """The page by TLS, with a certificate that the station has made."""
    with station(folder, "--web-port", "0", "--web-tls", "self") as (running, url):
        async with browsing(folder) as browser:
            await browser.call("Security.setIgnoreCertificateErrors", ignore=True)
            await browser.open(url)
            await browser.until("Waiting for a platform")
            fingerprint = re.search(r"(?:[0-9A-F]{2}:){31}[0-9A-F]{2}", running.text, re.IGNORECASE)
            return {
                "url": url,
                "is_secure": await browser.evaluate("isSecureContext && location.protocol == 'https:'"),
                "fingerprint": fingerprint is not None,
                "plain": sum(one.startswith(("http:", "ws:")) for one in browser.requested),
            }


# --- what it costs ---


async def costs(folder: Path) -> dict[str, float]:
    """Processor time of the station and of the browser with twenty vehicles, by page; of the station alone, too."""
    port, found = free_port(), {}
    with station(folder, "--web-port", "0", port=port) as (running, url), loaded(port, VEHICLES, PARTS, RATE_HZ):
        await asyncio.sleep(WARM_S)
        found["nobody"] = await share([running.process.pid])
        async with browsing(folder) as browser:
            for page in PAGES:
                await browser.open(url + page)
                await asyncio.sleep(4.0)
                heard = await vehicles_shown(browser, page)
                before = browser.received_bytes
                ours, theirs = await asyncio.gather(share([running.process.pid]), share(children("chromium", folder)))
                found |= {f"{page} station": ours, f"{page} browser": theirs, f"{page} vehicles": heard}
                found[f"{page} bytes_s"] = (browser.received_bytes - before) / WATCH_S
    return found


async def vehicles_shown(browser: Browser, page: str) -> int:
    """How many vehicles a page knows."""
    if page == "map":
        return int(await browser.evaluate("document.querySelectorAll('#vehicles button').length"))
    if page == "pictures":
        return int(await browser.evaluate("document.getElementById('vehicle').options.length"))
    title = re.search(r"vehicle_\d\d\d \d+/(\d+)", browser.terminal.text())
    return int(title[1]) if title is not None else 0


async def share(processes: Sequence[int]) -> float:
    """Their part of a core."""
    before, begin_s = sum(map(spent_s, processes)), time.perf_counter()
    await asyncio.sleep(WATCH_S)
    return (sum(map(spent_s, processes)) - before) / (time.perf_counter() - begin_s)


def spent_s(process: int) -> float:
    """Processor seconds so far; 0 of a process that has ended."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / TICKS


def children(name: str, folder: Path) -> list[int]:
    """The processes of a browser that runs in a folder: its own, and those that it has started."""
    own, parents = set[int](), dict[int, int]()
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                command = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
                parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except OSError:
                continue
            if name in command and str(folder) in command:
                own.add(int(entry.name))
    while more := {one for one, parent in parents.items() if parent in own} - own:
        own |= more
    return sorted(own)
