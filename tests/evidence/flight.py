"""Speed, determinism and accuracy of flights in virtual time, and control flights that must turn the figures red."""

import filecmp
import math
import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from tests.evidence.page import ROOT, Bar, Figure, Progress
from tests.flight.accuracy import CALM_LIMITS, WIND_RMS_M, cut_corners, hover, skip_a_leg
from tests.flight.card import Card

from gloc3_sitl.flight.path_error import PathResult

GLOC3 = str(ROOT / ".venv/bin/gloc3")
SPEED_RUNS = 5
CALM_RMS_M, CALM_MAX_M = CALM_LIMITS
LEAST_SHARE = 0.9
CONTROL_SPEED_M_S = 0.5


def fly(
    seed: int, out: Path, *, wind_m_s: float = 0.0, hash_seed: int = 0, is_one_core: bool = False
) -> dict[str, Any]:
    """Flies the patrol in a process of its own; the report, and what the process took from outside."""
    command = [GLOC3, "fly", "patrol", "--seed", str(seed), "--out", str(out), "--quiet"]
    if wind_m_s:
        command += ["--wind", str(wind_m_s)]
    if is_one_core:
        command = ["taskset", "-c", "0", *command]
    environment = {**os.environ, "PYTHONHASHSEED": str(hash_seed)}
    begin_s, before = time.perf_counter(), os.times()
    subprocess.run(command, check=True, capture_output=True, env=environment)
    wall_s, after = time.perf_counter() - begin_s, os.times()
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    report = msgspec.json.decode((out / "report.json").read_bytes())
    return {"report": report, "wall_s": wall_s, "cpu_s": cpu_s}


def speed() -> dict[str, float]:
    """The best of some runs on one core, timed from outside."""
    best: dict[str, float] = {"factor": 0.0}
    for _ in range(SPEED_RUNS):
        with tempfile.TemporaryDirectory() as folder:
            result = fly(1, Path(folder) / "a", is_one_core=True)
        simulated_s = result["report"]["wall"]["simulated_s"]
        if simulated_s / result["wall_s"] > best["factor"]:
            best = {
                "factor": simulated_s / result["wall_s"],
                "simulated_s": simulated_s,
                "wall_s": result["wall_s"],
                "cpu_s": result["cpu_s"],
            }
    return best


def same() -> dict[str, Any]:
    """Two runs of one seed, and one of another, in wind."""
    with tempfile.TemporaryDirectory() as folder:
        one, two, other = (Path(folder) / name for name in ("one", "another/place", "other"))
        first = fly(5, one, wind_m_s=6.0, hash_seed=1)["report"]
        second = fly(5, two, wind_m_s=6.0, hash_seed=4242)["report"]
        third = fly(6, other, wind_m_s=6.0)["report"]
        first.pop("wall")
        second.pop("wall")
        return {
            "logs": filecmp.cmp(one / "log.mcap", two / "log.mcap", shallow=False),
            "bytes": (one / "log.mcap").stat().st_size,
            "reports": first == second,
            "other": third["distance_m"] != first["distance_m"],
        }


def controls() -> dict[str, dict[str, float]]:
    """Flights that are wrong on purpose, judged like the others."""
    return {
        name: _figures(_on_a_card(wrong))
        for name, wrong in (("hovers", hover), ("skips a leg", skip_a_leg), ("cuts corners", cut_corners))
    }


def _on_a_card(wrong: Callable[[Card], PathResult]) -> PathResult:
    with tempfile.TemporaryDirectory() as folder:
        card = Card("px4", Path(folder))
        try:
            return wrong(card)
        finally:
            card.close()


def _figures(result: PathResult) -> dict[str, float]:
    return {
        "rms_m": result.rms_m,
        "max_m": result.max_m,
        "passed": result.passed,
        "of": len(result.legs),
        "slowest_m_s": result.slowest_m_s,
    }


def run(progress: Progress) -> list[Figure]:
    """The bar."""
    fast = progress.part("speed", speed)
    figures = [
        Figure("simulated, seconds", f"{fast['simulated_s']:.0f}", "≥ 300", fast["simulated_s"] >= 300.0),
        Figure(f"wall time on one core, best of {SPEED_RUNS}, seconds", f"{fast['wall_s']:.1f}"),
        Figure("processor time, seconds", f"{fast['cpu_s']:.1f}"),
        Figure("times faster than real time", f"{fast['factor']:.0f}", "≥ 50", fast["factor"] >= 50.0),
    ]
    equal = progress.part("determinism", same)
    figures += [
        Figure(
            "log.mcap of two processes, one seed",
            "identical" if equal["logs"] else "differ",
            "identical",
            equal["logs"],
        ),
        Figure("… its size in bytes", str(equal["bytes"])),
        Figure("report.json but for `wall`", "equal" if equal["reports"] else "differ", "equal", equal["reports"]),
        Figure(
            "another seed in wind", "flies another way" if equal["other"] else "the same", "another way", equal["other"]
        ),
    ]
    for name, wind, rms, most in (
        ("calm", 0.0, CALM_RMS_M, CALM_MAX_M),
        ("6 m/s gusty wind", 6.0, WIND_RMS_M, math.inf),
    ):
        report = progress.part(f"accuracy {name}", partial(_accuracy, wind))
        passed, requested = report["waypoints_passed"], report["waypoints"]
        figures += [
            Figure(
                f"{name}: path error, RMS in m",
                f"{report['path_rms_error_m']:.3f}",
                f"≤ {rms}",
                report["path_rms_error_m"] <= rms,
            ),
            Figure(
                f"{name}: path error, max in m",
                f"{report['path_max_error_m']:.3f}",
                f"≤ {most}" if most < math.inf else "",
                report["path_max_error_m"] <= most,
            ),
            Figure(f"{name}: waypoints in order within 0.3 m", f"{passed} of {requested}", "all", passed == requested),
            Figure(
                f"{name}: slowest leg, share of the speed asked for",
                f"{report['slowest_leg_share']:.2f}",
                f"≥ {LEAST_SHARE:.2f}",
                report["slowest_leg_share"] >= LEAST_SHARE,
            ),
        ]
    return [*figures, *_controlled(progress.part("controls", controls))]


def _controlled(flights: dict[str, dict[str, float]]) -> list[Figure]:
    """That each control flight turns some figure red, and each figure is turned red by some control flight."""
    figures, caught = [], dict.fromkeys(("RMS", "max", "waypoints", "speed"), "")
    for name, result in flights.items():
        is_red = {
            "RMS": result["rms_m"] > CALM_RMS_M,
            "max": result["max_m"] > CALM_MAX_M,
            "waypoints": result["passed"] < result["of"],
            "speed": result["slowest_m_s"] < LEAST_SHARE * CONTROL_SPEED_M_S,
        }
        red = [figure for figure in caught if is_red[figure]]
        for figure in red:
            caught[figure] = name
        value = (
            f"RMS {result['rms_m']:.2f} m, max {result['max_m']:.2f} m, {result['passed']:.0f} of {result['of']:.0f} "
            f"passed, slowest leg {result['slowest_m_s']:.2f} m/s; red: {', '.join(red) or 'none'}"
        )
        figures.append(Figure(f"control flight that {name}", value, "red", bool(red)))
    for figure, name in caught.items():
        figures.append(
            Figure(f"figure `{figure}` turns red", f"by the one that {name}" if name else "never", "yes", bool(name))
        )
    return figures


def _accuracy(wind_m_s: float) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        report: dict[str, Any] = fly(3, Path(folder) / "a", wind_m_s=wind_m_s)["report"]
    return report


BARS = (
    Bar(
        "flight",
        "A simulated flight is 50 times faster than real time, repeatable and accurate",
        "`gloc3 fly patrol`, with everything logged, is at least 50 times faster than real time on one core, start-up "
        "included. One seed gives one log, byte for byte, and the vehicle stays on its path.",
        run,
        seeds="1 for speed, 5 and 6 for determinism, 3 for accuracy",
    ),
)
