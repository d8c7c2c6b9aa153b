"""The main job on a fresh clone, and Ctrl-C at any moment of it."""

import math
import os
import random
import signal
import subprocess
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from tests.evidence.marker import compare
from tests.evidence.page import ROOT, Bar, Figure, Progress

INTERRUPTIONS = 8
NO_REPORT = {"mission_state": "no report", "path_rms_error_m": None, "images": 0, "wall": {"total_s": math.inf}}
NOTHING_SEEN = {"must": 0, "shown": 0, "false": 0, "images": 0}


def fresh_clone() -> dict[str, Any]:
    """Clones the project, runs only `make demo`, and looks at what it leaves."""
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / "gloc3"
        subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
        begin_s = time.perf_counter()
        done = subprocess.run(["make", "demo"], cwd=clone, stdin=subprocess.DEVNULL, check=False)
        elapsed_s = time.perf_counter() - begin_s
        out = clone / "runs" / "demo"
        kept = sorted(path.name for path in out.iterdir()) if out.exists() else []
        report = msgspec.json.decode((out / "report.json").read_bytes()) if "report.json" in kept else NO_REPORT
        seen = compare(out) if "images" in kept else NOTHING_SEEN
    return {"code": done.returncode, "took_s": elapsed_s, "report": report, "seen": seen, "kept": kept}


def own_pose(platform: str) -> dict[str, Any]:
    """Flies the inspection by the sensors of a platform alone, in three processes and real time."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "demo"
        command = [str(ROOT / ".venv/bin/gloc3"), "demo", "inspection", "--platform", platform, "--out", str(out)]
        begin_s = time.perf_counter()
        done = subprocess.run(command, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
        elapsed_s = time.perf_counter() - begin_s
        kept = out / "report.json"
        report = msgspec.json.decode(kept.read_bytes()) if kept.exists() else NO_REPORT
    return {"code": done.returncode, "took_s": elapsed_s, "report": report}


def interrupt(seed: int) -> dict[str, Any]:
    """Starts the demonstration and presses Ctrl-C at a random moment."""
    moment_s = random.Random(seed).uniform(0.3, 45.0)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "demo"
        command = [str(ROOT / ".venv/bin/gloc3"), "demo", "inspection", "--out", str(out)]
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True)
        time.sleep(moment_s)
        os.killpg(process.pid, signal.SIGINT)
        begin_s = time.perf_counter()
        process.wait(60.0)
        ended_s = time.perf_counter() - begin_s
        left = subprocess.run(["pgrep", "-f", str(out)], capture_output=True, text=True, check=False).stdout.split()
        log = out / "log.mcap"
        info = [str(ROOT / ".venv/bin/gloc3"), "log", "info", str(log)]
        readable = not log.exists() or subprocess.run(info, capture_output=True, check=False).returncode == 0
    return {"moment_s": moment_s, "ended_s": ended_s, "left": len(left), "is_readable": readable}


def run(progress: Progress) -> list[Figure]:
    """The bar."""
    first = progress.part("fresh clone", fresh_clone)
    report, seen = first["report"], first["seen"]
    figures = [
        Figure("exit code of `make demo`", str(first["code"]), "0", first["code"] == 0),
        Figure("set-up and flight, seconds", f"{first['took_s']:.0f}"),
        Figure("flight part, seconds", f"{report['wall']['total_s']:.0f}", "≤ 120", report["wall"]["total_s"] <= 120.0),
        Figure("mission", report["mission_state"], "done", report["mission_state"] == "done"),
        Figure("path error, RMS in m", str(report["path_rms_error_m"])),
        Figure("images", str(report["images"]), "> 0", report["images"] > 0),
        Figure("images that must show the marker", str(seen["must"]), "> 0", seen["must"] > 0),
        Figure("… and show it", str(seen["shown"]), "all", seen["shown"] == seen["must"]),
        Figure("images that cannot show it, and do", str(seen["false"]), "0", seen["false"] == 0),
        Figure("left in the folder", ", ".join(first["kept"])),
    ]
    for platform in ("pelican", "hummingbird"):
        result = progress.part(platform, partial(own_pose, platform))
        report, title = result["report"], f"`gloc3 demo inspection --platform {platform}`, no satellites"
        error_m = report["path_rms_error_m"]
        is_done = result["code"] == 0 and report["mission_state"] == "done"
        figures += [
            Figure(f"{title}: mission", report["mission_state"], "done", is_done),
            Figure("… seconds in all", f"{result['took_s']:.0f}", "≤ 120", result["took_s"] <= 120.0),
            Figure("… path error, RMS in m", str(error_m), "≤ 0.3", error_m is not None and error_m <= 0.3),
            Figure("… images", str(report["images"]), "> 0", report["images"] > 0),
        ]
    for seed in range(INTERRUPTIONS):
        result = progress.part(f"interrupt {seed}", partial(interrupt, seed))
        fine = result["left"] == 0 and result["is_readable"]
        value = f"ended after {result['ended_s']:.1f} s, {result['left']} processes left, log readable: {result['is_readable']}"
        figures.append(Figure(f"Ctrl-C after {result['moment_s']:.1f} s", value, "none left, readable", fine))
        progress.report(value)
    return figures


BARS = (
    Bar(
        "demo",
        "A fresh clone flies the inspection with one command, in less than two minutes",
        "A fresh clone and `make demo`: three processes fly the inspection within two minutes. The recorded images "
        "show the floor marker exactly where the truth says that it is in view. Platforms without satellites fly by "
        "their own sensors. Ctrl-C leaves no process behind and a readable log.",
        run,
        seeds=f"0 to {INTERRUPTIONS - 1} choose the moments of Ctrl-C",
    ),
)
