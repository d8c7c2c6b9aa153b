"""The real PX4: with its own physics and what befalls it in flight, and on our physics. Says so where it is not there."""

import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from tests.evidence import px4_flights
from tests.evidence.page import SCRATCH, Bar, Figure, Progress
from tests.evidence.px4_flights import Told
from tests.onboard.real_px4 import build_tree

from gloc3_sitl.demo.demo import PX4_COMPANION_PORT

INSTANCE = 5
"""Of PX4 with its own physics; on ours the programs take the first."""
PATH_M = 0.3
ON_OURS: Sequence[tuple[str, str, Sequence[str]]] = (
    ("fly", "hop", ("--platform", "pelican_rtk")),
    ("demo", "hop", ("--platform", "pelican_rtk")),
    ("fly", "inspection", ("--platform", "pelican")),
    ("demo", "inspection", ("--platform", "pelican")),
)
"""Commands: in lockstep with virtual time and as three processes, with satellites and without."""


def on_ours(command: str, mission: str, options: Sequence[str]) -> dict[str, Any]:
    """A flight on our physics over PX4's simulator interface; its report."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        words = [sys.executable, "-m", "gloc3", command, mission, "--firmware", "px4", *options, "--out", str(out)]
        done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        kept = out / "report.json"
        report: dict[str, Any] = msgspec.json.decode(kept.read_bytes()) if kept.exists() else {}
    return {"code": done.returncode, "report": report, "last": done.stderr.strip().splitlines()[-1:]}


def _figure_of(command: str, mission: str, options: Sequence[str], result: dict[str, Any]) -> Figure:
    report = result["report"]
    name = f"`gloc3 {command} {mission} {' '.join(options)} --firmware px4`"
    state, error_m = report.get("mission_state", "no report"), report.get("path_rms_error_m")
    passed = f", {report['waypoints_passed']} of {report['waypoints']} waypoints" if report.get("waypoints") else ""
    path = f", path error {error_m:.3f} m RMS" if error_m is not None else ""
    value = f"{state}{passed}{path}" if state == "done" else f"{state}: {' '.join(result['last'])}"
    is_met = result["code"] == 0 and state == "done" and (error_m is None or error_m <= PATH_M)
    return Figure(name, value, f"done, path error ≤ {PATH_M:g} m", is_met)


def run(progress: Progress) -> list[Figure]:
    """A row for each flight."""
    if build_tree() is None:
        why = "no: nothing was flown (docs/firmware.md)"
        return [Figure("`px4` of a build tree on PATH", why, "yes", is_met=False)]
    figures = []
    for title in px4_flights.FLIGHTS:
        folder = SCRATCH / "px4" / re.sub(r"\W+", "_", title)  # it comes into PATH, which knows no colons
        told = msgspec.convert(progress.part(title, partial(px4_flights.fly, title, folder, INSTANCE)), Told)
        bar = px4_flights.what_must_be(title)
        figures.append(Figure(title, f"not so: {told.problem}" if told.problem else told.said, bar, not told.problem))
        progress.report(f"{title}: {told.problem or told.said}")
    for command, mission, options in ON_OURS:
        title = " ".join((command, mission, *options))
        result = progress.part(title, partial(on_ours, command, mission, options))
        figures.append(_figure_of(command, mission, options, result))
        progress.report(f"{title}: {figures[-1].value}")
    return figures


BARS = (
    Bar(
        "px4",
        "The real PX4 flies missions, through pauses, pilots, restarts and losses",
        "PX4 1.16 (development) runs with its own physics (SIH) and a platform file that `gloc3 platform new` made "
        "from it, with the programs of a user: `gloc3 onboard` and `gloc3 station --headless`, in real time. Each row "
        "is a flight with a separate PX4; its value is what an operator reads at the station. The last rows are "
        "flights on the physics and sensors of GLOC3 over PX4's simulator interface (the three processes on UDP port "
        f"{PX4_COMPANION_PORT}).",
        run,
    ),
)
