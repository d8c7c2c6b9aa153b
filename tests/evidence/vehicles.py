"""Real autopilots with their built-in vehicle models, led by `gloc3 onboard`; for a computer that has them on PATH.

`python -m tests.evidence.vehicles NAME…` flies some of them for the commit at hand; the page takes what has been flown.
"""

import asyncio
import re
import shutil
import sys
from collections.abc import Sequence
from functools import partial
from typing import Any, Final, NamedTuple

import msgspec
from tests.evidence.page import SCRATCH, Bar, Figure, Progress, basis
from tests.onboard.real_journey import Led, lead
from tests.onboard.real_vehicle import COPTER, PLANE, QUADPLANE, ROVER, SUB, Vehicle

PAGE: Final = "vehicles"
WIND_M_S: Final = 9.0


class Journey(NamedTuple):
    """One vehicle, and the wind."""

    vehicle: Vehicle
    most_m: float
    """Bar of its distance from the straight ways."""
    wind_m_s: float = 0.0

    @property
    def title(self) -> str:
        """Its name on the page."""
        return self.vehicle.name + (f" in {self.wind_m_s:g} m/s of wind" if self.wind_m_s else "")


JOURNEYS: Final[tuple[Journey, ...]] = (
    Journey(COPTER, 1.0),
    Journey(COPTER, 1.5, WIND_M_S),
    Journey(ROVER, 2.0),
    Journey(SUB, 0.6),
    Journey(PLANE, 60.0),
    Journey(PLANE, 60.0, WIND_M_S),
    Journey(QUADPLANE, 60.0),
    Journey(QUADPLANE, 60.0, WIND_M_S),
)


def make(journey: Journey) -> dict[str, Any]:
    """One journey, or why it did not end as it should."""
    folder = SCRATCH / PAGE / re.sub(r"\W+", "_", journey.title)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        return {"led": msgspec.to_builtins(asyncio.run(lead(journey.vehicle, folder, journey.wind_m_s)))}
    except AssertionError as error:
        (folder / "problem.txt").write_text(str(error))
        return {"problem": str(error).strip().splitlines()[0]}


def figures_of(journey: Journey, progress: Progress) -> list[Figure]:
    """A few figures of a journey."""
    name, vehicle = journey.title, journey.vehicle
    if shutil.which(vehicle.binary) is None:
        return [Figure(name, "not on PATH", "the mission is done", is_met=False)]
    result = progress.part(name, partial(make, journey))
    if "problem" in result:
        progress.report(f"{name}: {result['problem']}")
        return [Figure(name, result["problem"], "the mission is done", is_met=False)]
    found = msgspec.convert(result["led"], Led)
    progress.report(f"{name}: done, off the way by {found.rms_m} m RMS")
    wait_m = vehicle.wait_m
    return [
        Figure(name, f"done, disarmed {found.home_m} m from home", "the mission is done"),
        Figure(
            f"{name}: waypoints missed by",
            ", ".join(f"{value} m" for value in found.misses_m),
            f"under {vehicle.near_m:g} m",
            max(found.misses_m) < vehicle.near_m,
        ),
        Figure(
            f"{name}: off the way, RMS and most",
            f"{found.rms_m} m, {found.most_m} m",
            f"at most {journey.most_m:g} m",
            found.most_m <= journey.most_m,
        ),
        Figure(
            f"{name}: paused, it stays within", f"{found.wait_m} m", f"under {wait_m:g} m", found.wait_m < wait_m
        ),
        Figure(
            f"{name}: the mission's fence on the autopilot, and the least distance to it",
            f"{found.fence}, {found.inside_m} m",
            "confirmed, never left",
            found.fence == "confirmed" and found.inside_m > 0.0,
        ),
        Figure(f"{name}: pictures taken beside", str(found.pictures), "at least 3", found.pictures >= 3),
        Figure(f"{name}: taken for a pilot's", "yes" if found.had_pilot else "never", "never", not found.had_pilot),
    ]  # fmt: skip


def vehicles(progress: Progress) -> list[Figure]:
    """The figures of all journeys."""
    return [figure for journey in JOURNEYS for figure in figures_of(journey, progress)]


BARS = (
    Bar(
        PAGE,
        "ArduPilot's own programs and vehicles carry out missions unchanged",
        "ArduPilot's own programs (4.7 development) with ArduPilot's own physics are started as a user starts them; "
        "only the address of the link is changed. `gloc3 onboard` and `gloc3 station --headless` fly, drive and dive "
        "a box inside a fence while pictures are taken. The station is killed on the way, and the mission continues. "
        "Another station takes control, pauses the mission, sees the vehicle stand (or circle) and resumes it. The "
        "vehicle returns home and ends landed, standing or at the surface, disarmed. All but the rover get their "
        "preset first (`gloc3 preset apply`). Fixed wings continue from their circle straight to the next waypoint; "
        "their path is judged after that. The wind comes from the north, along the planes' runway, and has the same "
        "speed at every height.",
        vehicles,
    ),
)


def main(names: Sequence[str]) -> int:
    """Flies those whose titles are given, or all."""
    progress = Progress(PAGE, basis("tests.evidence.vehicles"))
    known = {journey.title: journey for journey in JOURNEYS}
    figures = [figure for name in names or known for figure in figures_of(known[name], progress)]
    return 0 if all(figure.is_met for figure in figures) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
