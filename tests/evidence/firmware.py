"""The real ArduCopter on our physics: with satellites, without, and how fast. Says so where its program is not there."""

import asyncio
import os
import shutil
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.sitl.firmware.real_flight import fly

from gloc3_sitl.physics.wind import gusty

PROGRAM = "arducopter"
HOVER_RMS_M = 0.3
HOVER_S = 60.0
WIND_M_S = 5.0
SPEED_S = 60.0
CORNERS = """
mission: four corners under a real firmware
frame: hold
platform: pelican_rtk
tasks:
  all:
    actions:
      up: {take_off: {height_m: 2.0}}
      still: {hold: {duration_s: 30}, after: [up]}
      corners: {follow_waypoints: {waypoints_m: [[8, 2, 2], [8, 8, 2], [4, 8, 3], [4, 4, 2]], speed_m_s: 1.0}, after: [still]}
      down: {land: {}, after: [corners]}
"""


def version() -> str:
    """What the program calls itself: in the first words of its file that look so."""
    path = shutil.which(PROGRAM)
    assert path is not None
    data = Path(path).read_bytes()
    begin = data.find(b"ArduCopter V")
    return data[begin : data.find(b"\0", begin)].decode(errors="replace") if begin >= 0 else "unknown"


def guided(wind_m_s: float) -> dict[str, Any]:
    """The flight of a bare client, as fast as its hover can be judged."""
    with tempfile.TemporaryDirectory() as folder:
        wind = {"wind": gusty(wind_m_s, 200.0)} if wind_m_s else {}
        flown = asyncio.run(fly(Path(folder), speed=2.0, hover_s=HOVER_S, **wind))
    return flown._asdict()


def fastest() -> dict[str, float]:
    """How many simulated seconds pass in one of the wall clock where nobody holds them back."""
    command = [sys.executable, "-m", "gloc3", "sitl", "--firmware", "ardupilot", "--world", "open", "--speed", "50"]
    begin_s = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [*command, "--link", "udpout://127.0.0.1:24999", "--seconds", f"{SPEED_S:g}", "--out", folder],
            capture_output=True,
            text=True,
            check=True,
        )
    wall_s = time.perf_counter() - begin_s
    simulated_s = float(done.stderr.rpartition("ended after ")[2].partition(" s")[0])
    return {"simulated_s": simulated_s, "wall_s": wall_s}


def stack(command: str, mission: str, *options: str) -> dict[str, Any]:
    """Our physics with the real firmware, the onboard process and a station, as `demo` or `fly` have them; the report."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        file = Path(folder) / "mission.yaml"
        file.write_text(mission)
        name = str(file) if "\n" in mission else mission
        words = [sys.executable, "-m", "gloc3", command, name, "--firmware", "ardupilot", *options, "--out", str(out)]
        begun = os.getloadavg()[0]
        done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        kept = out / "report.json"
        report: dict[str, Any] = msgspec.json.decode(kept.read_bytes()) if kept.exists() else {"mission_state": "none"}
    last = done.stderr.strip().splitlines()[-1:]
    load = max(begun, os.getloadavg()[0]) / (os.cpu_count() or 1)
    return {"code": done.returncode, "report": report, "last": last, "load": load}


def run(progress: Progress) -> list[Figure]:
    """The bar, where the program is there."""
    if shutil.which(PROGRAM) is None:
        return [Figure(f"`{PROGRAM}` on PATH", "no: nothing was flown (docs/firmware.md)", "yes", is_met=False)]
    figures = [Figure("firmware", version())]
    for name, wind_m_s in (("calm", 0.0), (f"{WIND_M_S:g} m/s gusty wind", WIND_M_S)):
        flown = progress.part(f"guided {wind_m_s:g}", partial(guided, wind_m_s))
        worst_m = max(flown["misses_m"])
        figures += [
            Figure(
                f"GUIDED, {name}: hover error over {HOVER_S:g} s, RMS in m",
                f"{flown['hover_rms_m']:.3f}",
                f"≤ {HOVER_RMS_M}",
                flown["hover_rms_m"] <= HOVER_RMS_M,
            ),
            Figure(f"GUIDED, {name}: … largest in m", f"{flown['hover_max_m']:.3f}"),
            Figure(f"GUIDED, {name}: farthest miss of 4 waypoints, m", f"{worst_m:.2f}", "≤ 0.5", worst_m <= 0.5),
            Figure(
                f"GUIDED, {name}: landed, disarmed, started anew by command, ended",
                "yes" if flown["code"] == 0 else f"exit code {flown['code']}",
                "yes",
                flown["code"] == 0,
            ),
        ]
    fast = progress.part("fastest", fastest)
    factor = fast["simulated_s"] / fast["wall_s"]
    figures.append(Figure("times real time with cameras off, start-up included", f"{factor:.1f}", "≥ 1", factor >= 1.0))
    for title, command, mission, options in (
        ("three processes, with satellites", "demo", CORNERS, ()),
        ("cargo hold by ODOMETRY alone, in step with virtual time", "fly", "inspection", ("--platform", "pelican")),
        ("cargo hold by ODOMETRY alone, three processes", "demo", "inspection", ("--platform", "pelican")),
    ):
        result = progress.part(title, partial(stack, command, mission, *options))
        report = result["report"]
        is_done = report["mission_state"] == "done"
        figures += [
            Figure(f"{title}: mission", report["mission_state"], "done", is_done),
            Figure(f"{title}: programs to each processor of the computer meanwhile", f"{result['load']:.1f}"),
        ]
        if is_done:
            passed, requested = report["waypoints_passed"], report["waypoints"]
            figures += [
                Figure(f"{title}: waypoints within 0.3 m", f"{passed} of {requested}", "all", passed == requested),
                Figure(f"{title}: path error, RMS in m", f"{report['path_rms_error_m']:.3f}"),
            ]
        else:
            figures.append(Figure(f"{title}: its last words", " ".join(result["last"])))
    return figures


BARS = (
    Bar(
        "firmware",
        "The real ArduPilot flies on GLOC3's physics, with and without satellites",
        "ArduPilot's own simulation build flies on our physics, sensors and worlds by its JSON interface: with a "
        "plain MAVLink client, and with `gloc3 onboard` and `gloc3 station`; with satellites, and without them by our "
        "pose as `ODOMETRY` alone. PX4's interface has been tested against a peer written from its public "
        "description; the real firmware has not flown on it yet.",
        run,
    ),
)
