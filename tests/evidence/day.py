"""The bar on a day's work: a million events and eight hours of tracks in a station that stays quick and small."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from math import cos, sin
from pathlib import Path
from statistics import quantiles
from typing import Any

import msgspec
from tests.evidence.page import Bar, Figure, Progress

from gloc3.messages.envelope import Severity
from gloc3.messages.motion import MotionSummary

EVENTS = 1_000_000
VEHICLES = 10
HOURS = 8.0
SAMPLES_HZ = 4.0
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


async def fill(count: int, hours: float = 0.0) -> dict[str, Any]:
    """Has a station with its terminal follow vehicles and hear events for so long, and looks through it all by keys."""
    from tests.groundstation.station_scene import scene
    from textual.widgets import Input

    async with scene(None, size=(120, 40)) as here:
        here.platform.speak()
        await here.go("9")
        before_mb = resident_mb()
        if hours:
            await _fly(here, hours)
        tracks_mb = resident_mb()
        begin_s = time.thread_time()
        for number in range(count):
            here.platform.event(
                f"{WORDS[number % 6]}, number {number}", Severity(3 + number % 4), f"part_{number % 20}"
            )
            if number % 2000 == 0:
                here.app.show_fleet()
                await here.pilot.pause(0)
        added_s = time.thread_time() - begin_s
        await here.press("slash")
        await here.wait(lambda: isinstance(here.app.focused, Input))
        desk, slowest_s, typed = here.app.desk.events, 0.0, f"number {count // 2 + 7}"
        begin_s = time.thread_time()
        for place in range(len(typed)):
            key_s = time.thread_time()
            here.app.screen.query_one("#search", Input).value = typed[: place + 1]
            await here.wait(lambda place=place: desk.search.wanted.text == typed[: place + 1])  # type: ignore[misc]
            await here.pilot.pause(0)
            slowest_s = max(slowest_s, time.thread_time() - key_s)
        while not desk.search.is_done:
            step_s = time.thread_time()
            here.app.show_fleet()
            slowest_s = max(slowest_s, time.thread_time() - step_s)
            await here.pilot.pause(0)
        search_s = time.thread_time() - begin_s
        await here.press("enter")
        await here.wait(lambda: not isinstance(here.app.focused, Input))
        views = {}
        for screen, digit in (("map", "4"), ("data", "5"), ("events", "9"), ("overview", "1")):
            await here.go(digit)
            views[screen] = _slow_ms(here.app.show_fleet)
        return {
            "added_us": added_s / max(1, count) * 1e6,
            "slowest_ms": slowest_s * 1e3,
            "search_s": search_s,
            "found": len(desk.search),
            "before_mb": before_mb,
            "tracks_mb": tracks_mb - before_mb,
            "after_mb": resident_mb(),
            "looks_ms": views,
        }


async def _fly(here: Any, hours: float) -> None:
    """Ten vehicles tell for so many hours how they move: in circles that climb and sink, in the time of the station."""
    from tests.groundstation.flown import SITE
    from tests.groundstation.scripted_platform import ScriptedPlatform

    platforms = [ScriptedPlatform(here.exchange, f"vehicle_{number}", 20 + number) for number in range(1, VEHICLES)]
    platforms.append(here.platform)
    now_s = here.station.now_s()
    here.station.now_s = lambda: now_s
    for platform in platforms:
        platform.report("site", SITE)
        platform.fly(is_armed=True, mode="OFFBOARD", landed="in_air")
    for n in range(round(hours * 3600.0 * SAMPLES_HZ)):
        t_s = n / SAMPLES_HZ
        now_s += 1.0 / SAMPLES_HZ
        x, y, height = 30.0 * sin(t_s / 60.0), 20.0 * cos(t_s / 47.0), 3.0 + sin(t_s / 5.0)
        motion = MotionSummary(
            t_s=t_s,
            attitude_cdeg=(round(900 * sin(t_s / 3.0)), 0, n % 36000),
            position_cm=(round(100 * x), round(100 * y), round(100 * height)),
            velocity_cm_s=(50, 0, 0),
            is_pose_valid=True,
            battery_cv=1640,
            battery_ca=1450,
        )
        for platform in platforms:
            platform.report("motion", motion)
        if n % 400 == 0:
            here.app.show_fleet()
            await here.pilot.pause(0)


def _slow_ms(poll: Callable[[], None], times: int = 20) -> float:
    """The 95th percentile of what a look costs, in processor time."""
    costs_s = []
    for _ in range(times):
        begin_s = time.thread_time()
        poll()
        costs_s.append(time.thread_time() - begin_s)
    return quantiles(costs_s, n=20)[18] * 1e3


def day(progress: Progress, count: int = EVENTS, hours: float = HOURS) -> list[Figure]:
    """In a process of its own, so that its memory is its own."""
    program = (
        "import asyncio, msgspec, sys; from tests.evidence.day import fill; "
        f"sys.stdout.write(msgspec.json.encode(asyncio.run(fill({count}, {hours}))).decode())"
    )

    def run() -> Any:
        done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True, timeout=1200)
        return msgspec.json.decode(done.stdout)

    result = progress.part(f"fill {count} {hours}", run)
    return [
        Figure("events heard, kept and shown", f"{count:,}"),
        Figure("tracks kept and shown", f"{VEHICLES} vehicles, {hours:g} h, {SAMPLES_HZ:g} samples a second"),
        Figure("memory of the process, MB", f"{result['after_mb']:.0f}", "< 300", result["after_mb"] < 300.0),
        Figure("of which there before the first event, MB", f"{result['before_mb']:.0f}"),
        Figure("of which for the tracks, MB", f"{result['tracks_mb']:.0f}"),
        Figure(
            "cost of an event, µs of processor time (station, store and a scripted vehicle)",
            f"{result['added_us']:.0f}",
        ),
        Figure(
            "longest that the terminal is busy while a search is typed, ms of processor time",
            f"{result['slowest_ms']:.0f}",
            "< 100",
            result["slowest_ms"] < 100.0,
        ),
        Figure(
            "a search for one event typed letter by letter, to its end, s of processor time",
            f"{result['search_s']:.1f}",
        ),
        Figure("events that fit", str(result["found"]), "1", result["found"] == 1),
        *(
            Figure(f"a look at the {screen} afterwards, p95, ms of processor time", f"{cost:.0f}", "< 50", cost < 50.0)
            for screen, cost in result["looks_ms"].items()
        ),
    ]


BARS = (
    Bar(
        "day",
        "After 8 hours, ten vehicles and a million events the station is still quick",
        "A station receives 1,000,000 events and follows ten vehicles for 8 hours. All events can be searched while "
        "the operator types, map and charts are drawn as fast as in the first minute, and the process stays below 300 "
        "MB.",
        day,
    ),
)
