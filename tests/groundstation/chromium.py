"""A headless Chromium, driven over its DevTools protocol: as much as a journey needs."""

import asyncio
import base64
import itertools
import json
import os
import re
import shutil
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from websockets.asyncio.client import ClientConnection, connect

from .emulator import Emulator

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
READY_S = 30.0
KEYS = {
    "enter": ("Enter", 13, "\r"),
    "escape": ("Escape", 27, ""),
    "down": ("ArrowDown", 40, ""),
    "f5": ("F5", 116, ""),
}


def found() -> str | None:
    """The program, where there is one."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Browser:
    """One page. What it is sent over its websocket is shown to an emulator too, so that it can be read."""

    def __init__(self, devtools: ClientConnection, columns: int, lines: int) -> None:
        self.terminal = Emulator(columns, lines)
        self.requested: list[str] = []
        """The addresses of everything that the page has asked for."""
        self.problems: list[str] = []
        self.received_bytes = 0
        self._devtools = devtools
        self._numbers = itertools.count(1)
        self._answers: dict[int, asyncio.Future[dict[str, Any]]] = {}

    async def listen(self) -> None:
        async for text in self._devtools:
            message = json.loads(text)
            if "id" in message:
                self._answers.pop(message["id"]).set_result(message)
                continue
            match message["method"], message["params"]:
                case "Network.webSocketFrameReceived", {"response": {"opcode": 2, "payloadData": data}}:
                    drawn = base64.b64decode(data)
                    self.received_bytes += len(drawn)
                    self.terminal.feed(drawn)
                case "Network.webSocketFrameSent", {"response": {"payloadData": data}}:
                    said = json.loads(data)
                    if said[0] in ("hello", "resize") and "width" in said[1]:
                        self.terminal.resize(said[1]["width"], said[1]["height"])
                case "Network.requestWillBeSent", {"request": {"url": url}}:
                    self.requested.append(url)
                case "Runtime.exceptionThrown", params:
                    self.problems.append(json.dumps(params))
                case "Log.entryAdded", {"entry": {"source": "security" | "violation"} as entry}:
                    self.problems.append(json.dumps(entry))

    async def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        number = next(self._numbers)
        self._answers[number] = asyncio.get_running_loop().create_future()
        await self._devtools.send(json.dumps({"id": number, "method": method, "params": parameters}))
        answer = await asyncio.wait_for(self._answers[number], READY_S)
        assert "error" not in answer, answer["error"]
        result: dict[str, Any] = answer["result"]
        return result

    async def open(self, url: str) -> None:
        """Loads a page; what an earlier one showed is forgotten."""
        self.terminal = Emulator(*self.terminal.size)
        await self.call("Page.navigate", url=url)

    async def evaluate(self, expression: str) -> Any:
        """The value of an expression in the page."""
        return (await self.call("Runtime.evaluate", expression=expression, returnByValue=True))["result"].get("value")

    async def press(self, *keys: str) -> None:
        """Presses keys, by name or as what they type."""
        for key in keys:
            name, code, text = KEYS[key] if key in KEYS else (key, ord(key.upper()), key)
            event = {"key": name, "windowsVirtualKeyCode": code}
            await self.call("Input.dispatchKeyEvent", type="keyDown", **event, **({"text": text} if text else {}))
            await self.call("Input.dispatchKeyEvent", type="keyUp", **event)

    async def click(self, x: float, y: float) -> None:
        """Clicks at a place of the page, in pixels."""
        for kind in ("mousePressed", "mouseReleased"):
            await self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    async def tap(self, selector: str) -> None:
        """Taps an element with a finger, in its middle."""
        box = await self.evaluate(
            f"(({{x, y, width, height}}) => [x + width / 2, y + height / 2])(document.querySelector({selector!r})"
            ".getBoundingClientRect())"
        )
        await self.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": box[0], "y": box[1]}])
        await self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    async def emulate(self, width: int, height: int, *, is_touch: bool, scale: float = 1.0) -> None:
        """Makes the window as large as a device's, with a finger or a mouse."""
        await self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=is_touch
        )
        await self.call("Emulation.setTouchEmulationEnabled", enabled=is_touch)

    async def until_shown(self, expression: str, within_s: float = READY_S) -> float:
        """Waits until an expression in the page is true; how long that took, s."""
        begin_s = asyncio.get_running_loop().time()
        while not await self.evaluate(expression):
            took_s = asyncio.get_running_loop().time() - begin_s
            assert took_s < within_s, f"never true: {expression}"
            await asyncio.sleep(0.05)
        return asyncio.get_running_loop().time() - begin_s

    async def until(self, text: str, within_s: float = READY_S) -> None:
        """Waits until the terminal shows a text."""
        await self.wait(lambda: text in self.terminal.text(), within_s, text)

    async def wait(self, is_so: Callable[[], bool], within_s: float = READY_S, what: str = "it") -> None:
        for _ in range(round(within_s / 0.05)):
            if is_so():
                return
            await asyncio.sleep(0.05)
        raise AssertionError(f"never came: {what}\n{self.terminal.text()}")

    async def picture(self) -> bytes:
        """What is seen, as PNG."""
        return base64.b64decode((await self.call("Page.captureScreenshot", format="png"))["data"])


@asynccontextmanager
async def chromium(folder: Path, width: int = 1000, height: int = 600) -> AsyncIterator[Browser]:
    """A browser with one empty page; its files are left in a folder."""
    program = found()
    assert program is not None
    process = await asyncio.create_subprocess_exec(
        program,
        *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--disable-quic"),
        *("--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"),
        *("--remote-debugging-port=0", f"--user-data-dir={folder}", f"--window-size={width},{height}", "about:blank"),
        env={**os.environ, "HOME": str(folder)},
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        async with asyncio.timeout(READY_S):
            address = await _devtools_address(process)
        page = re.sub(r"/devtools/.*", "", address)
        async with connect(address, max_size=None) as control:
            await control.send(json.dumps({"id": 1, "method": "Target.getTargets"}))
            targets = json.loads(await control.recv())["result"]["targetInfos"]
            target = next(each["targetId"] for each in targets if each["type"] == "page")
        async with connect(f"{page}/devtools/page/{target}", max_size=None) as devtools:
            browser = Browser(devtools, 80, 24)
            listening = asyncio.create_task(browser.listen())
            for domain in ("Page", "Network", "Runtime", "Log"):
                await browser.call(f"{domain}.enable")
            try:
                yield browser
            finally:
                listening.cancel()
    finally:
        process.kill()
        await process.communicate()


async def _devtools_address(process: asyncio.subprocess.Process) -> str:
    assert process.stderr is not None
    text = b""
    async for line in process.stderr:
        text += line
        if match := re.search(rb"DevTools listening on (\S+)", line):
            return match[1].decode()
    raise AssertionError(f"Chromium did not start: {text.decode(errors='replace')}")
