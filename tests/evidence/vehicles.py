"""Real autopilots with their built-in vehicle models, led by `gloc3 onboard`; for a computer that has them on PATH."""

import asyncio
import shutil
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.real_journey import SIZES, Led, lead
from tests.onboard.real_vehicle import COPTER, ROVER, SUB, Vehicle

VEHICLES = (COPTER, ROVER, SUB)


def exchange(vehicle: Vehicle) -> dict[str, Any]:
    """One journey, or why it did not end as it should."""
    with tempfile.TemporaryDirectory() as name:
        try:
            return {"led": msgspec.to_builtins(asyncio.run(lead(vehicle, Path(name))))}
        except AssertionError as error:
            return {"problem": str(error).strip().splitlines()[0]}


def vehicles(progress: Progress) -> list[Figure]:
    """A few figures a vehicle."""
    figures: list[Figure] = []
    for vehicle in VEHICLES:
        name = f"{vehicle.binary} --model {vehicle.model}"
        if shutil.which(vehicle.binary) is None:
            figures.append(Figure(name, "not on PATH", "the mission is done", is_met=False))
            continue
        result = progress.part(vehicle.binary, partial(exchange, vehicle))
        if "problem" in result:
            figures.append(Figure(name, result["problem"], "the mission is done", is_met=False))
            continue
        found = msgspec.convert(result["led"], Led)
        _, _, near_m = SIZES[vehicle.binary]
        figures += [
            Figure(name, "done, disarmed", "the mission is done"),
            Figure(
                f"{name}: waypoints missed by",
                _listed(found.misses_m),
                f"under {near_m} m",
                max(found.misses_m) < near_m,
            ),
            Figure(f"{name}: off the way, RMS and most", f"{found.rms_m} m, {found.most_m} m"),
            Figure(f"{name}: pictures taken beside", str(found.pictures), "at least 3", found.pictures >= 3),
            Figure(f"{name}: taken for a pilot's", "yes" if found.had_pilot else "never", "never", not found.had_pilot),
        ]
    return figures


def _listed(values: list[float]) -> str:
    return ", ".join(f"{value} m" for value in values)


BARS = (
    Bar(
        "vehicles",
        "Real autopilots with vehicles of their own",
        "ArduPilot's own programs (4.7 development), started as a user starts them, with nothing of ours changed but the "
        "address of the link: `gloc3 onboard` and `gloc3 station --headless` fly, drive and dive a box while pictures are "
        "taken. The station is killed on the way; the mission goes on; another station takes control, pauses it, sees the "
        "vehicle stand, resumes it, and it ends landed, standing or at the surface, disarmed. ArduSub needs the preset "
        "ardusub_companion first, which is shown and applied by command.",
        vehicles,
    ),
)
