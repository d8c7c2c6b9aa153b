"""Vehicles without a companion, commanded through their autopilots: embedded ones and, where they are on PATH, the real ones."""

import asyncio
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import Final

from tests.evidence.page import ROOT, Bar, Figure, Progress
from tests.groundstation.services.action_journey import fly, fly_by_script
from tests.groundstation.services.test_services_with_sitl import at, simulated
from tests.onboard.real_px4 import RealPx4
from tests.onboard.real_vehicle import COPTER
from tests.onboard.real_vehicle import simulated as real_ardupilot

from gloc3.errors import Gloc3Error

INSTANCE: Final = 6
COMMANDS: Final = 13
BY_SCRIPT: Final = 12
JOURNEYS: Final = {
    "by keys and palette": "tests/groundstation/tui/test_bare_vehicle_journey.py",
    "each class of ArduPilot": "tests/groundstation/services/test_actions_with_sitl.py",
    "companion killed in flight, brought down by the station": "tests/commands/test_a_companion_dies.py",
}


@contextmanager
def embedded(style: str) -> Iterator[str]:
    """Its link."""
    with simulated(style) as port:
        yield f"udpout://127.0.0.1:{port}"


@contextmanager
def real_px4() -> Iterator[str]:
    """PX4 with its own physics; where it speaks to ground stations."""
    with tempfile.TemporaryDirectory() as folder, RealPx4(Path(folder), instance=INSTANCE):
        yield "udpin://127.0.0.1:14550"


@contextmanager
def real_copter() -> Iterator[str]:
    """ArduPilot's copter with its own physics."""
    with tempfile.TemporaryDirectory() as folder, real_ardupilot(COPTER, Path(folder, "sitl")) as lines:
        yield lines.first


AUTOPILOTS: Final[Mapping[str, Callable[[], AbstractContextManager[str]]]] = {
    "embedded, in PX4's style": partial(embedded, "px4"),
    "embedded, in ArduPilot's style": partial(embedded, "ardupilot"),
    "PX4 (SIH)": real_px4,
    "ArduCopter": real_copter,
}


def flown(name: str) -> dict[str, str]:
    """What was seen of each command."""

    async def main(url: str) -> dict[str, str]:
        async with at(url) as (services, link):
            return await fly(services, link)

    try:
        with AUTOPILOTS[name]() as url:
            return asyncio.run(main(url))
    except (AssertionError, TimeoutError, Gloc3Error, OSError) as error:
        return {"problem": f"{type(error).__name__} {error}".strip()}


def scripted(name: str) -> dict[str, str]:
    """What was seen of each command by the API for scripts."""
    try:
        with AUTOPILOTS[name]() as url, tempfile.TemporaryDirectory() as folder:
            return asyncio.run(fly_by_script(url, Path(folder)))
    except (AssertionError, TimeoutError, Gloc3Error, OSError) as error:
        return {"problem": f"{type(error).__name__} {error}".strip()}


def tested(path: str) -> str:
    """The last line of a test file."""
    called = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", path]
    ended = subprocess.run(called, cwd=ROOT, check=False, capture_output=True, text=True)
    last = (ended.stdout.strip().splitlines() or [ended.stderr])[-1]
    return last if ended.returncode == 0 else f"not so: {last}"


def run(progress: Progress) -> Sequence[Figure]:
    """The figures."""
    figures = []
    for name in AUTOPILOTS:
        seen: dict[str, str] = progress.part(name, partial(flown, name))
        progress.report(f"{name}: {seen.get('problem') or f'{len(seen)} commands'}")
        is_met = len(seen) >= COMMANDS
        figures.append(
            Figure(f"{name}: commands tried to the end", seen.get("problem", str(len(seen))), f"≥ {COMMANDS}", is_met)
        )
        figures += [Figure(f"… {command}", words) for command, words in seen.items() if command != "problem"]
        by_script: dict[str, str] = progress.part(f"{name} by script", partial(scripted, name))
        progress.report(f"{name} by the API: {by_script.get('problem') or f'{len(by_script)} commands'}")
        is_met = len(by_script) >= BY_SCRIPT
        count = by_script.get("problem", str(len(by_script)))
        figures.append(
            Figure(f"{name}, by the API for scripts: commands tried to the end", count, f"≥ {BY_SCRIPT}", is_met)
        )
        figures += [Figure(f"… {command}", words) for command, words in by_script.items() if command != "problem"]
    for title, path in JOURNEYS.items():
        said = progress.part(title, partial(tested, path))
        figures.append(Figure(f"{title} ({path})", said, "passed", not said.startswith("not so")))
    return figures


BARS = (
    Bar(
        "bare-vehicles",
        "The station commands PX4 and ArduPilot vehicles that have no companion",
        "The ground station commands autopilots directly. Each command is sent by the service that the keys and the "
        "palette use (modes by the station's own DO_SET_MODE, everything else by MAVSDK in a separate process). The "
        "figure is what the vehicle's own telemetry shows of it. The real programs run with their own physics, over "
        "UDP and TCP, in real time.",
        run,
    ),
)
