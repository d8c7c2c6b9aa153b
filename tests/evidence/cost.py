"""What the sensors' processing costs on one core, and how fast a flight with everything is; and whether it is repeatable."""

import filecmp
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from tests.benchmarks import fusion, ground, laser, stereo, world
from tests.benchmarks.world import remap_ms
from tests.evidence.machine import Cost, at_most
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.algorithms.vision.flights import fly, inspection

from gloc3.mission.examples import find_mission
from gloc3_sitl.world import World

GLOC3 = str(Path(sys.executable).with_name("gloc3"))
REPEATS = 3
"""The least disturbed of so many counts."""
MOST_MS, MOST_WITH_PICTURES_MS = 333.0, 500.0
"""Of processor time a simulated second."""
PHOTOS = "record_images"


@contextmanager
def one_core() -> Iterator[None]:
    """This process, and those that it starts, stay on one core."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def least(costs_ms: Callable[[], list[float]]) -> dict[str, float]:
    """Mean, 99th percentile and largest, each of the repeat in which it was the least."""
    with one_core():
        runs = [costs_ms() for _ in range(REPEATS)]
    return {
        "mean": min(float(np.mean(run)) for run in runs),
        "p99": min(float(np.percentile(run, 99)) for run in runs),
        "worst": min(max(run) for run in runs),
        "remap": remap_ms(),
    }


def pairs_ms(name: str) -> list[float]:
    """Features and motion for each pair of pictures of ten seconds of a flight."""
    pairs = list(fly(inspection(1).select(slice(200, 200 + stereo.COUNT)), name, 1))
    features, motions = stereo.costs_ms(pairs)
    return [a + b for a, b in zip(features, motions, strict=True)]


def pictures_ms(name: str) -> list[float]:
    """Pictures of the camera whose lens bends, with noise, along a lap; the first, which prepares, aside."""
    place = World.load(name)
    poll = world.looks(place)["a picture of front_left, radtan lens"]
    return world.each_ms(poll, world.lap_truths(place))


def fused() -> dict[str, float]:
    """Milliseconds for a step of the inertial unit, with its share of all measurements and without."""
    with one_core():
        whole, alone = fusion.cost_ms()
    return {"whole": whole, "alone": alone, "remap": remap_ms()}


def flight(out: Path, mission: str, hash_seed: int = 0) -> dict[str, float]:
    """Flies with all sensors in a process of its own; times from outside."""
    command = [GLOC3, "fly", mission, "--platform", "pelican", "--seed", "1", "--out", str(out), "--quiet"]
    begin_s, before = time.perf_counter(), os.times()
    subprocess.run(command, check=True, capture_output=True, env={**os.environ, "PYTHONHASHSEED": str(hash_seed)})
    wall_s, after = time.perf_counter() - begin_s, os.times()
    report = msgspec.json.decode((out / "report.json").read_bytes())
    return {
        "simulated_s": report["wall"]["simulated_s"],
        "wall_s": wall_s,
        "cpu_s": after.children_user + after.children_system - before.children_user - before.children_system,
        "pictures": report["images"],
        "remap_ms": remap_ms(),
    }


def without_photos(folder: Path) -> str:
    """The inspection without the action that records pictures; the ground camera is looked through all the same."""
    lines = find_mission("inspection").read_text().splitlines(keepends=True)
    file = folder / "inspection.yaml"
    file.write_text("".join(line for line in lines if PHOTOS not in line))
    return str(file)


def fastest(*, has_photos: bool) -> dict[str, float]:
    """The best of some flights on one core."""
    with one_core(), tempfile.TemporaryDirectory() as name:
        mission = "inspection" if has_photos else without_photos(Path(name))
        runs = [flight(Path(name) / str(number), mission) for number in range(REPEATS)]
    return min(runs, key=lambda run: run["cpu_s"] / run["remap_ms"])


def same() -> dict[str, Any]:
    """Two processes with other hash seeds, folders and numbers of cores."""
    with tempfile.TemporaryDirectory() as name:
        one, two = Path(name) / "one", Path(name) / "another/place"
        with one_core():
            flight(one, "inspection", hash_seed=1)
        flight(two, "inspection", hash_seed=4242)
        pictures = sorted(file.relative_to(one) for file in (one / "images").iterdir())
        _, differ, missing = filecmp.cmpfiles(one, two, map(str, pictures), shallow=False)
        return {
            "log": filecmp.cmp(one / "log.mcap", two / "log.mcap", shallow=False),
            "bytes": (one / "log.mcap").stat().st_size,
            "pictures": not differ and not missing,
        }


def parts(progress: Progress) -> list[Figure]:
    """The bars of each part."""
    figures = []

    def add(title: str, costs_ms: Callable[[], list[float]], key: str, bar_ms: float) -> None:
        progress.report(title)
        found = progress.part(title, partial(least, costs_ms))
        words, cost = (
            {"mean": "mean", "p99": "99th percentile", "worst": "worst"}[key],
            Cost(found[key], found["remap"]),
        )
        figures.append(Figure(f"{title}: {words}", str(cost), at_most(bar_ms), cost.is_at_most(bar_ms)))

    for name in ("hold", "hold_hard"):
        title = f"features, matches and motion of a stereo pair, {name}"
        add(title, partial(pairs_ms, name), "mean", stereo.BAR_MS)
        add(title, partial(pairs_ms, name), "worst", 20.0)
    add("motion over the ground of a picture", ground.ground, "mean", ground.BAR_MS)
    title = "motion by the laser, 360 beams"
    add(title, laser.odometer_ms, "mean", laser.BAR_MS)
    add(title, laser.odometer_ms, "p99", 4.0)
    progress.report("fusion")
    step = progress.part("fusion", fused)
    whole, bar_ms = Cost(step["whole"], step["remap"]), fusion.BAR_MS
    title = "pose fusion, a step of the inertial unit with its share of all measurements"
    figures.append(Figure(title, str(whole), at_most(bar_ms), whole.is_at_most(bar_ms)))
    figures.append(Figure("… the step alone, ms", f"{step['alone']:.3f}"))
    add("a picture with distortion and noise, hold", partial(pictures_ms, "hold"), "mean", 5.0)
    title = "the same blurred, by lamps and with dust, hold_hard"
    hard = progress.part(title, partial(least, partial(pictures_ms, "hold_hard")))
    figures.append(Figure(f"{title}: mean, ms", f"{hard['mean']:.2f}"))
    return figures


def run(progress: Progress) -> list[Figure]:
    """The bar."""
    figures = parts(progress)
    for has_photos, bar_ms in ((False, MOST_MS), (True, MOST_WITH_PICTURES_MS)):
        title = "flight with all sensors" + (", pictures recorded" if has_photos else "")
        progress.report(title)
        found = progress.part(title, partial(fastest, has_photos=has_photos))
        cost = Cost(1e3 * found["cpu_s"] / found["simulated_s"], found["remap_ms"])
        figures += [
            Figure(f"{title}: a simulated second", str(cost), at_most(bar_ms), cost.is_at_most(bar_ms)),
            Figure("… times faster than real time", f"{found['simulated_s'] / found['wall_s']:.1f}"),
            Figure(
                f"… simulated, on the wall (best of {REPEATS}) and in the processor, s",
                f"{found['simulated_s']:.0f}, {found['wall_s']:.1f}, {found['cpu_s']:.1f}",
            ),
        ]
        if has_photos:
            figures.append(Figure("… pictures recorded", str(found["pictures"]), "≥ 1", found["pictures"] > 0))
    progress.report("the same again")
    equal = progress.part("same", same)
    for key, what in (("log", "log.mcap"), ("pictures", "the recorded pictures")):
        value = "identical" if equal[key] else "differ"
        figures.append(Figure(f"{what} of two processes, one on one core", value, "identical", equal[key]))
    figures.append(Figure("… bytes of the log", str(equal["bytes"])))
    return figures


BARS = (
    Bar(
        "inspection-cost",
        "An inspection flight with all sensors takes no more than a third of a core",
        "Pictures have 640 x 480 pixels. Costs of the parts are processor time on one core, the least disturbed of "
        "three runs, beside one remap of a picture at the same moment. Those of the flights are measured from outside, start-up and report included, with `gloc3 fly "
        "inspection --platform pelican`: four cameras, laser scanner, inertial unit, all odometers, two pose fusions, "
        "everything logged.",
        run,
        seeds="1",
    ),
)
