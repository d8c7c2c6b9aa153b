"""`docs/performance.md`: figures of speed, latency, load and accuracy, quoted from the pages of evidence."""

import re
from importlib import import_module
from pathlib import Path
from typing import Final, NamedTuple

from tests.benchmarks.__main__ import BENCHES
from tests.house.table import table

EVIDENCE: Final = Path(__file__).parents[2] / "docs" / "evidence"
PAGE: Final = EVIDENCE.parent / "performance.md"
HEAD: Final = """\
# Performance

How fast, how late, how heavy and how accurate GLOC3 is. Every figure is quoted from a page of evidence, which names the
commit at which it was measured and states its bar; `make docs` makes this page from them. The command beside a figure
measures it again. Wall times and loads are those of the computer of that run, with two cores; accuracies are those of
simulated flights unless the figure names a data set.
"""
NOT_COMPILED: Final = """\
## Why it is not compiled

A flight in virtual time has no part that takes most of the time. `gloc3 fly patrol --seed 1` under cProfile makes 59 million
calls in 671 simulated seconds, and the function with the largest share has 2 %: the event loop. The search for cyclic
garbage takes 0.2 %. Other interpreters were measured once, by hand, in processor time, in turn with the one that is used:

| what | time of a patrol, as a share |
| --- | --- |
| mypyc on 70 modules, all that may be compiled of what runs most | 0.85 |
| CPython 3.12 instead of 3.11 | 1.0 |
| CPython 3.13 instead of 3.11 | 1.0 |

With mypyc, messages and settings stay interpreted, because msgspec builds them from their class bodies, and so do
components, which other people's classes derive from. The compiled process crashed at its exit. A seventh of the time does not
pay for a wheel for each processor beside the pure one, with every log compared between the two. A search of many
flights gains more from cores: `gloc3 prove` flies on all of them.
"""
BENCH_HEAD: Final = """\
## On your computer

`make bench` measures the parts where you are; `.venv/bin/python -m tests.benchmarks NAME` one of them. It prints costs
per cycle or per message, and sets no bar.
"""


class Quote(NamedTuple):
    """One figure."""

    page: str
    figure: str
    """Its name on the page."""
    what: str
    """In the words of this page, with the unit."""


CHAPTERS: Final = {
    "Simulation": (
        Quote("flight", "times faster than real time", "a flight by the autopilot's pose, times faster than real time"),
        Quote(
            "inspection-cost",
            "flight with all sensors: a simulated second",
            "a second of a flight with cameras, laser and pose fusion, processor time",
        ),
        Quote("demo", "set-up and flight, seconds", "a fresh clone to the end of the demo, s"),
    ),
    "Latency": (
        Quote("network-cost", "local delivery, in µs", "a message to a component of the same process, µs"),
        Quote("network-cost", "pose: delay p50, µs", "a pose between two processes, median, µs"),
        Quote("network-cost", "picture of 640 x 480: delay p50, µs", "a picture between two processes, median, µs"),
        Quote("router", "200/s: delay, gloc3, in µs", "a MAVLink frame through the router, µs"),
        Quote(
            "terminal-cost",
            "10 vehicles × 20 components at 10 Hz: key press to repaint, p95, ms",
            "a key at the station, 95 %, ms",
        ),
    ),
    "Radio": (
        Quote(
            "link",
            "upload, median in seconds",
            "a mission of 20 kB at 57,600 baud, 20 % of the frames lost each way, s",
        ),
        Quote("link", "status while a mission uploads, share of the link", "status, share of that link meanwhile"),
        Quote(
            "radio",
            "longest time without a heartbeat, in seconds",
            "longest time without a heartbeat on a busy radio, s",
        ),
        Quote(
            "radio",
            "a plan of 50 items to the autopilot, worst in seconds",
            "a plan of 50 items through that radio, worst, s",
        ),
    ),
    "Load": (
        Quote(
            "inspection-cost",
            "features, matches and motion of a stereo pair, hold: mean",
            "stereo odometry, a pair",
        ),
        Quote("inspection-cost", "motion over the ground of a picture: mean", "ground odometry, a picture"),
        Quote("inspection-cost", "motion by the laser, 360 beams: mean", "laser odometry, a scan"),
        Quote("router", "2,000/s: processor of a frame, gloc3, in µs", "routing a MAVLink frame, µs of processor time"),
        Quote("router", "2,000/s: processor of a frame, MAVProxy, in µs", "the same by MAVProxy, µs"),
        Quote(
            "terminal-cost",
            "10 vehicles × 20 components at 10 Hz: share of a core, %",
            "a station with 10 vehicles, % of a core",
        ),
        Quote(
            "terminal-cost",
            "100 vehicles × 20 components at 1 Hz: share of a core, %",
            "a station with 100 vehicles, % of a core",
        ),
        Quote("day", "memory of the process, MB", "a station after 8 h, 10 vehicles and a million events, MB"),
    ),
    "Accuracy": (
        Quote("flight", "calm: path error, RMS in m", "path, calm, RMS, m"),
        Quote("flight", "6 m/s gusty wind: path error, RMS in m", "path, 6 m/s gusty wind, RMS, m"),
        Quote("pose", "hold: ATE RMS, worst seed (mean)", "pose without satellites over 60 m, worst of the seeds"),
        Quote("wheel-odometry", "off at the end of it, RMS", "rover after a minute without satellites, RMS"),
        Quote("dead-reckoning", "auv, off when it comes up, RMS", "AUV when it comes up, RMS"),
        Quote("laser-drift", "csail, gloc3", "laser odometry on recorded scans (csail)"),
    ),
}


def page() -> str:
    """The whole page.

    Raises:
        KeyError: a page of evidence has no such figure any more.
    """
    lines = [HEAD]
    for title, quotes in CHAPTERS.items():
        lines += [f"## {title}\n", *table(("what", "value", "bar", "command"), map(_row, quotes))]
    lines.append(NOT_COMPILED)
    benches = ((f"`{name}`", _first_line(name)) for name in BENCHES)
    lines += [BENCH_HEAD, *table(("bench", "measures"), benches)]
    return "\n".join(lines).rstrip() + "\n"


def _row(quote: Quote) -> tuple[str, str, str, str]:
    text = (EVIDENCE / f"{quote.page}.md").read_text(encoding="utf-8")
    value, bar = figures(text)[quote.figure]
    return quote.what, f"[{value}](evidence/{quote.page}.md)", bar, f"`make evidence NAME={quote.page}`"


def figures(text: str) -> dict[str, tuple[str, str]]:
    """Values and bars of a page of evidence, by name; of a name that comes twice, the first."""
    found: dict[str, tuple[str, str]] = {}
    for line in text.splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip().strip("|"))]
        if line.startswith("| ") and len(cells) == 4:
            found.setdefault(cells[0], (cells[1], cells[2]))
    return found


def _first_line(name: str) -> str:
    text = import_module(f"tests.benchmarks.{name}").__doc__ or ""
    return " ".join(text.split("\n\n")[0].split())
