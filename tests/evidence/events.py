"""The bar on a day's events: a million of them in a station that stays quick and small."""

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from tests.evidence.page import Bar, Figure, Progress

EVENTS = 1_000_000
WORDS = (
    "gust of 7 m/s",
    "no frame for 1.0 s",
    "setpoint clamped",
    "battery below 30 %",
    "working -> quiet",
    "pose is late",
)


def resident_mb() -> float:
    """What this process has in memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


async def fill(count: int) -> dict[str, Any]:
    """Has a station with its terminal hear so many events, and looks through them by keys."""
    from tests.groundstation.station_scene import scene
    from textual.widgets import Input

    from gloc3.messages import Severity

    async with scene(None, size=(120, 40)) as here:
        here.platform.speak()
        await here.go("9")
        before_mb = resident_mb()
        begin_s = time.perf_counter()
        for number in range(count):
            here.platform.event(
                f"{WORDS[number % 6]}, number {number}", Severity(3 + number % 4), f"part_{number % 20}"
            )
            if number % 2000 == 0:
                here.app.look()
                await here.pilot.pause(0)
        added_s = time.perf_counter() - begin_s
        await here.press("slash")
        await here.wait(lambda: isinstance(here.app.focused, Input))
        desk, slowest_s, typed = here.app.desk.events, 0.0, f"number {count // 2 + 7}"
        begin_s = time.perf_counter()
        for place in range(len(typed)):
            key_s = time.perf_counter()
            here.app.screen.query_one("#search", Input).value = typed[: place + 1]
            await here.wait(lambda place=place: desk.search.wanted.text == typed[: place + 1])  # type: ignore[misc]
            await here.pilot.pause(0)
            slowest_s = max(slowest_s, time.perf_counter() - key_s)
        while not desk.search.is_done:
            step_s = time.perf_counter()
            here.app.look()
            slowest_s = max(slowest_s, time.perf_counter() - step_s)
            await here.pilot.pause(0)
        return {
            "added_us": added_s / count * 1e6,
            "slowest_ms": slowest_s * 1e3,
            "search_s": time.perf_counter() - begin_s,
            "found": len(desk.search),
            "before_mb": before_mb,
            "after_mb": resident_mb(),
        }


def day_of_events(progress: Progress) -> list[Figure]:
    """In a process of its own, so that its memory is its own."""
    program = (
        "import asyncio, msgspec, sys; from tests.evidence.events import fill; "
        f"sys.stdout.write(msgspec.json.encode(asyncio.run(fill({EVENTS}))).decode())"
    )

    def run() -> Any:
        import msgspec

        done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True, timeout=1200)
        return msgspec.json.decode(done.stdout)

    result = progress.part("fill", run)
    return [
        Figure("events heard, kept and shown", f"{EVENTS:,}"),
        Figure("memory of the process, MB", f"{result['after_mb']:.0f}", "< 300", result["after_mb"] < 300.0),
        Figure("of which there before the first event, MB", f"{result['before_mb']:.0f}"),
        Figure("cost of an event, µs (station, store and a scripted vehicle)", f"{result['added_us']:.0f}"),
        Figure(
            "longest wait for the terminal while a search is typed, ms",
            f"{result['slowest_ms']:.0f}",
            "< 100",
            result["slowest_ms"] < 100.0,
        ),
        Figure("a search for one event typed letter by letter, to its end, s", f"{result['search_s']:.1f}"),
        Figure("events that fit", str(result["found"]), "1", result["found"] == 1),
    ]


BARS = (
    Bar(
        "events",
        "A day's events",
        "A station hears 1,000,000 events. All of them can be searched while one types, none slows the terminal, and the "
        "process stays below 300 MB.",
        day_of_events,
    ),
)
