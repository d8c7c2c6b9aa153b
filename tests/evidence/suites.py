"""Bars that are shown by test suites: what ran, and what passed."""

import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from tests import everything, unit
from tests.evidence.page import ROOT, SCRATCH, Bar, Figure, Progress


def run_tests(name: str, arguments: Sequence[str]) -> dict[str, Any]:
    """Runs pytest; the outcome of every test, and the seconds that it took in all."""
    report = SCRATCH / f"{name}.xml"
    begin_s = time.perf_counter()
    subprocess.run([sys.executable, "-m", "pytest", "-q", f"--junitxml={report}", *arguments], cwd=ROOT, check=False)
    return {"outcomes": outcomes(report), "took_s": round(time.perf_counter() - begin_s, 1)}


def outcomes(report: Path) -> dict[str, str]:
    """Of every test in a JUnit report."""
    found: dict[str, str] = {}
    for case in ET.parse(report).getroot().iter("testcase"):
        bad = next((child.tag for child in case if child.tag in ("failure", "error", "skipped")), "passed")
        found[f"{case.get('classname', '').rpartition('.')[2]}: {case.get('name', '')}"] = bad
    return found


def run_everything() -> dict[str, Any]:
    """Runs all tests as `make test` does; what `run_tests` returns, and how many were run again."""
    reports = SCRATCH / "all"
    begin_s = time.perf_counter()
    everything.run(reports)
    elapsed_s = time.perf_counter() - begin_s
    again = outcomes(reports / "alone.xml") if (reports / "alone.xml").exists() else {}
    found = outcomes(reports / "wall.xml") | outcomes(reports / "virtual.xml") | again
    return {"outcomes": found, "took_s": round(elapsed_s, 1), "again": len(again)}


def run_unit() -> dict[str, Any]:
    """Runs the quick tests as `make unit` does; what `run_tests` returns."""
    reports = SCRATCH / "unit"
    begin_s = time.perf_counter()
    unit.run(reports)
    elapsed_s = time.perf_counter() - begin_s
    found = [outcomes(reports / f"unit-{part}.xml") for part in range(unit.PARTS)]
    return {"outcomes": {test: how for one in found for test, how in one.items()}, "took_s": round(elapsed_s, 1)}


def suite(name: str, arguments: Sequence[str]) -> Callable[[Progress], list[Figure]]:
    """A bar that is met when every test of a suite passes, flights in both styles of autopilot."""

    def run(progress: Progress) -> list[Figure]:
        result = progress.part("tests", lambda: run_tests(name, ["--every-style", *arguments]))
        found: dict[str, str] = result["outcomes"]
        passed = sum(outcome == "passed" for outcome in found.values())
        figures = [Figure("tests passed", f"{passed} of {len(found)}", "all, at least one", 0 < passed == len(found))]
        figures += [
            Figure(test.replace("_", " ").replace("|", "\\|"), outcome, "passed", outcome == "passed")
            for test, outcome in found.items()
        ]
        return figures

    return run


def durations(progress: Progress) -> list[Figure]:
    """How long the suites take."""
    quick = progress.part("unit", run_unit)
    all_tests = progress.part("all", run_everything)
    failed = [
        test
        for test, outcome in (quick["outcomes"] | all_tests["outcomes"]).items()
        if outcome not in ("passed", "skipped")
    ]
    return [
        Figure("unit suite, seconds", f"{quick['took_s']:g}", "< 10", quick["took_s"] < 10.0),
        Figure("all tests, seconds", f"{all_tests['took_s']:g}", "< 480", all_tests["took_s"] < 480.0),
        Figure("tests that fail", str(len(failed)), "0", not failed),
        Figure("tests", str(len(all_tests["outcomes"]))),
        Figure("of these failed in wall time and were run again, alone", str(all_tests["again"])),
    ]


BARS = (
    Bar(
        "mavsdk",
        "Unmodified MAVSDK 4.1 flies the simulated vehicle",
        "MAVSDK connects over UDP, sees the simulated vehicle healthy and armable, arms it, takes off, goes to "
        "positions, flies an uploaded mission and lands. Where something is refused, it gets the right result.",
        suite(
            "mavsdk",
            [
                "tests/sitl/autopilot/test_mavsdk_with_px4_style.py",
                "tests/sitl/autopilot/test_mavsdk_with_ardupilot_style.py",
            ],
        ),
    ),
    Bar(
        "autopilot-cases",
        "The embedded autopilot serves MAVSDK's plugins and passes the test cases of other projects",
        "MAVSDK 4.1 does with the simulated vehicle what its plugins offer for a multirotor, in both styles, and is "
        "refused with the right result where the real firmware has no such function. The applicable cases of MAVSDK's "
        "system tests, of PX4's integration tests and of dronekit's scenarios pass.",
        suite(
            "autopilot-cases",
            [
                *("-n", "2", "--dist", "loadfile"),
                "tests/sitl/cases/test_mavsdk_on_the_ground.py",
                "tests/sitl/cases/test_mavsdk_system.py",
                "tests/sitl/cases/test_dronekit_scenarios.py",
                *(f"tests/evidence/cases/px4_{part}.py" for part in ("missions", "led", "trouble")),
                "tests/evidence/cases/mavsdk_flights.py",
                "tests/evidence/cases/mavsdk_slow.py",
                "tests/sitl/autopilot/test_power.py",
                "tests/sitl/autopilot/test_orbit_and_follow.py",
                "tests/sitl/autopilot/test_services_of_the_bench.py",
            ],
        ),
        seeds="as in the tests",
    ),
    Bar(
        "policies",
        "Failsafe policies, motion ownership and the pilot's priority hold in both autopilot styles",
        "Each failsafe policy, each rule about motion ownership and about the pilot, hung and crashed components and "
        "the hot standby are flown once in each style of autopilot.",
        suite("policies", ["-n", "2", "tests/flight"]),
        seeds="as in the tests",
    ),
    Bar(
        "add-a-component",
        "The page on adding a component works when it is followed literally",
        "A test follows `docs/add-a-component.md` literally: its code becomes a package, and its test passes.",
        suite("add-a-component", ["tests/architecture"]),
    ),
    Bar(
        "suites",
        "All tests take less than 8 minutes on 2 cores",
        "The unit suite takes less than 10 s, all tests less than 8 minutes on 2 cores. (Wall time on a shared machine.)",
        durations,
    ),
)
