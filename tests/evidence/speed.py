"""Speed, memory and delays beside the version before the work on them, and beside others' programs, in turn."""

import os
import pstats
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, Final, NamedTuple

import msgspec
from tests.benchmarks.history import Sample, ratios, sample_of, sources_of, take_samples
from tests.benchmarks.parts import FIGURES
from tests.benchmarks.sample import LOOP
from tests.evidence.page import ROOT, Bar, Figure, Progress
from tests.house.measure import PACKAGES

BEFORE: Final = "78cf552a"
"""The last commit before the work on speed."""
PAIRS: Final = 5
SITE: Final = "installed"
CALLERS: Final = 5
"""So many functions of a profile are named."""


class Row(NamedTuple):
    """What a figure must be."""

    bench: str
    """Of `tests.benchmarks.programs`; empty for one of the parts."""
    key: str
    what: str
    bar: float
    is_least: bool = False
    """More is better."""
    peer: str = ""
    """The figure of another program, in the same run."""
    of_before: float | None = None
    """At least so many times the version before."""
    of_peer: float | None = None


PARTS: Final = tuple(FIGURES)
ROWS: Final = (
    Row("patrol", "patrol times", "`fly patrol`, one core, times real time", 150.0, True, "physics times", 2.5, 0.45),
    Row("inspection", "inspection times", "`fly inspection --platform pelican`, two cores, times real time", 0.0, True,
        of_before=2.7),
    Row("", PARTS[0], "hosted cycle with one output, µs", 2.0),
    Row("", PARTS[1], "local delivery to 2 subscribers, µs", 0.4),
    Row("", PARTS[3], "a pose into the log, µs", 2.5, peer="foxglove-sdk µs"),
    Row("", PARTS[2], "MAVLink message encoded and decoded, µs", 2.0, peer="pymavlink µs"),
    Row("fusion", "fusion ms", "pose fusion, a step with its share of measurements, ms", 0.05),
    Row("stereo", "stereo ms", "stereo pair 640×480, features and motion, ms", 2.5),
    Row("onboard", "onboard MB", "onboard without cameras, memory, MB", 110.0),
    Row("onboard", "onboard %", "… in flight, share of a core, %", 5.0),
    Row("zenoh", "zenoh ratio", "delay of a pose, as a multiple of Zenoh's in its own thread", 1.25),
    Row("turnaround", "turnaround p50", "pose bytes in to setpoint bytes out, median, ms", 2.5),
    Row("turnaround", "turnaround p99", "… 99th percentile, ms", 6.0),
)  # fmt: skip


def environment(tree: Path) -> dict[str, str]:
    """The environment of a process that uses what is installed beside the sources of a tree, or else these sources."""
    site = tree / SITE
    folders = [site] if site.exists() else [tree / folder for folder in PACKAGES.values()]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, folders))}


def install(tree: Path) -> None:
    """Installs the sources of a tree beside them: its programs find their parts by the entry points of that commit."""
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--target", str(tree / SITE), str(tree)], check=True)


def program(bench: str, tree: Path) -> Sample:
    """A bench's figures with the sources of a tree."""
    command = [sys.executable, "-m", "tests.benchmarks.programs", bench]
    ended = subprocess.run(command, cwd=ROOT, env=environment(tree), check=True, stdout=subprocess.PIPE)
    return msgspec.json.decode(ended.stdout, type=dict[str, float])


def calls(tree: Path) -> dict[str, Any]:
    """The calls of a patrol, and the functions with the largest share of its time."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "profile"
        fly = ["-m", "gloc3", "fly", "patrol", "--seed", "1", "--out", folder, "--quiet"]
        command = [sys.executable, "-m", "cProfile", "-o", str(file), *fly]
        subprocess.run(command, cwd=ROOT, env=environment(tree), check=True, capture_output=True)
        stats: Any = pstats.Stats(str(file))
    largest = sorted(stats.stats.items(), key=lambda item: -item[1][2])[:CALLERS]
    return {
        "calls": stats.total_calls,
        "largest": [f"{name} {100.0 * each[2] / stats.total_tt:.1f} %" for (_, _, name), each in largest],
    }


def run(progress: Progress) -> Sequence[Figure]:
    """The page."""
    found: dict[str, tuple[list[dict[str, float]], list[dict[str, float]]]] = {}

    def take(name: str, sampler: Callable[[Path], Sample], before: Path | None) -> None:
        progress.report(name)
        found[name] = progress.part(name, lambda: take_samples(ROOT, before, sampler, PAIRS))

    with sources_of(BEFORE) as before:
        install(before)
        take("parts", lambda tree: sample_of(tree, LOOP, *PARTS), before)
        for bench in dict.fromkeys(row.bench for row in ROWS if row.bench):
            take(bench, partial(program, bench), before)
        for peer in dict.fromkeys(row.peer.partition(" ")[0] for row in ROWS if row.peer):
            take(peer, partial(program, peer), None)
        profiles = {
            key: progress.part(f"calls {key}", partial(calls, tree))
            for key, tree in (("now", ROOT), ("before", before))
        }
    unit_us = median(sample[LOOP] for sample in found["parts"][0])
    figures = [Figure("a step of a plain Python loop, ns", f"{1e3 * unit_us:.1f}")]
    for row in ROWS:
        figures += _judge(row, *found[row.bench or "parts"], found.get(row.peer.partition(" ")[0], ([], []))[0])
    for key, profile in profiles.items():
        text = f"{profile['calls'] / 1e6:.1f} million; most of the time: {', '.join(profile['largest'])}"
        figures.append(Figure(f"calls of a patrol, {key}", text))
    return figures


def _judge(
    row: Row, now: list[dict[str, float]], before: list[dict[str, float]], peer: list[dict[str, float]]
) -> Iterator[Figure]:
    """A figure and its bar; then its ratios to the version before, pair by pair, and to the peer."""
    value, was = (median(sample[row.key] for sample in samples) for samples in (now, before))
    if row.bar:
        is_met = value >= row.bar if row.is_least else value <= row.bar
        yield Figure(row.what, f"{value:.3g} (before {was:.3g})", f"{'≥' if row.is_least else '≤'} {row.bar:g}", is_met)
    else:
        yield Figure(row.what, f"{value:.3g} (before {was:.3g})")
    ratio = ratios(now, before)[row.key]
    text = f"{ratio.middle:.2f} ({ratio.least:.2f} to {ratio.most:.2f})"
    if row.of_before is None:
        yield Figure("… as a share of that before, pair by pair", text)
    else:
        yield Figure("… times that before, pair by pair", text, f"≥ {row.of_before:g}", ratio.middle >= row.of_before)
    if peer:
        other = median(sample[row.peer] for sample in peer)
        share = Figure(f"… as a share of {row.peer.rpartition(' ')[0]}'s {other:.3g}", f"{value / other:.2f}")
        if row.of_peer is not None:
            share = share._replace(bar=f"≥ {row.of_peer:g}", is_met=value / other >= row.of_peer)
        yield share


BARS = (
    Bar(
        "speed",
        "A flight is simulated faster, and the parts cost less, than before the work on speed",
        f"Everything is measured in turn with the sources of `{BEFORE}`, the last commit before that work, so that the "
        "machine's moods cancel out: five pairs, their median, the least and the most of the ratios. Times of the parts and of a "
        "patrol are of a processor, start-up and log included. The absolute bars were set on another machine; the plain Python "
        "loop's step compares the two. `physics` is the vehicle's body alone, JSBSim and rotors, at the same rate.",
        run,
        seeds="1",
    ),
)
