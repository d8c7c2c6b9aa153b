"""Delays of the control path: a component at 100 Hz beside the whole perception load, against a bare sleeping loop.

Run it on a computer that does nothing else: it takes 24 minutes. `python -m tests.evidence.real_time 60 [--without]`
measures once, for so many seconds.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from array import array
from contextlib import ExitStack
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

from tests.commands.programs import program
from tests.evidence.page import Bar, Figure, Progress

from gloc3.component.workers import REAL_TIME_PRIORITY

CORES = 2
RATE_HZ = 100
RUN_S = 600.0
WITHOUT_S = 60.0
"""Without priorities, which only informs."""
SETTLE_S = 30.0
MOST_P99_MS = 1.0
"""By which the 99th percentile may exceed that of the bare loop."""
MOST_STOP_MS = 5.0
"""By which the longest delay may exceed that of the bare loop."""
NICE = -5
"""Of the service's unit."""
LEAST = 19
"""The simulation's niceness: on a vehicle it is not on these cores."""

PROBE = '''
"""A component at 100 Hz that notes when it works."""

import time
from array import array
from pathlib import Path

from gloc3.component.component import SensorSampler
from gloc3.component.settings import Settings


class ProbeSettings(Settings, frozen=True):
    """None."""


class ProbeSampler(SensorSampler[ProbeSettings]):
    """Notes the time of each cycle, and writes all down when it stops."""

    def initialize(self, settings):
        self._times_s = array("d")

    def work(self, now_s, inbox):
        self._times_s.append(time.monotonic())
        return []

    def stop(self):
        Path("cycles").write_bytes(self._times_s.tobytes())
'''
PLATFORM = """\
platform: timed
extends: pelican
components:
  - {name: probe, class: "probe_sampler:ProbeSampler", rate_hz: 100, required: true}
"""
BARE = f"""
import os, sys, time
from array import array
if sys.argv[2] == "bare_first":
    os.sched_setscheduler(0, os.SCHED_RR, os.sched_param({REAL_TIME_PRIORITY}))
times, due = array("d"), time.monotonic()
while due < float(sys.argv[1]):
    due += {1.0 / RATE_HZ}
    time.sleep(max(0.0, due - time.monotonic()))
    times.append(time.monotonic())
open(sys.argv[2], "wb").write(times.tobytes())
"""
AWAKE = """
import os
os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
while True: pass
"""
"""Keeps a core from sleeping and takes no time from others: that of a virtual machine wakes when its host lets it."""
COLLECTED = "import gc; gc.freeze = lambda: None; from gloc3.cli.start import main; main()"
"""The program without `gc.freeze`."""


def delays_ms(file: Path, begin_s: float) -> list[float]:
    """By how much each cycle came later than a period after the one before, in ms."""
    times = array("d")
    times.frombytes(file.read_bytes())
    kept = [t_s for t_s in times if t_s >= begin_s]
    return [max(0.0, (later - earlier) * 1e3 - 1e3 / RATE_HZ) for earlier, later in pairwise(kept)]


def measured(run_s: float, *, is_service: bool) -> dict[str, Any]:
    """Delays of the probe in the onboard process, and of the bare loop beside it, in ms.

    Args:
        run_s: how long, after all has settled.
        is_service: with the priority of a service that is installed with `--real-time`, and `gc.freeze`; else without.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "probe_sampler.py").write_text(PROBE)
        (folder / "timed.yaml").write_text(PLATFORM)
        code = "from gloc3.cli.start import main; main()" if is_service else COLLECTED
        command = [
            sys.executable,
            "-c",
            code,
            "onboard",
            "timed.yaml",
            "--station",
            "udpout://127.0.0.1:9",
            "--out",
            "out",
        ]
        command += ["--real-time"] if is_service else []
        environment = {**os.environ, "PYTHONPATH": str(folder)}
        cores = os.sched_getaffinity(0)
        with ExitStack() as stack:
            stack.enter_context(
                program("sitl", "--vehicle", "pelican", folder=folder, before=("nice", "-n", str(LEAST)))
            )
            os.sched_setaffinity(0, sorted(cores)[:CORES])
            try:
                for _ in range(CORES):
                    awake = stack.enter_context(subprocess.Popen([sys.executable, "-c", AWAKE]))
                    stack.callback(awake.kill)
                before = ["nice", "-n", str(NICE)] if is_service else []
                onboard = subprocess.Popen([*before, *command], cwd=folder, env=environment)
                time.sleep(SETTLE_S)
                begin_s = time.monotonic()
                bare = [*before, sys.executable, "-c", BARE, str(begin_s + run_s)]
                first = subprocess.Popen([*bare, "bare_first"], cwd=folder)
                subprocess.run([*bare, "bare"], cwd=folder, check=True)
                assert first.wait(60.0) == 0
                onboard.terminate()
                assert onboard.wait(60.0) == 0
            finally:
                os.sched_setaffinity(0, cores)
        found = {name: sorted(delays_ms(folder / name, begin_s)) for name in ("cycles", "bare", "bare_first")}
    return {
        name: {"count": len(each), "p99": each[round(0.99 * (len(each) - 1))], "longest": each[-1]}
        for name, each in found.items()
    }


def run(progress: Progress) -> list[Figure]:
    """The figures of the page."""
    figures = []
    for title, is_service, run_s in (
        ("as a service with --real-time", True, RUN_S),
        ("once more, as a service with --real-time", True, RUN_S),
        ("without its priorities and gc.freeze", False, WITHOUT_S),
    ):
        found = progress.part(title, partial(measured, run_s, is_service=is_service))
        own, bare = found["cycles"], found["bare"]
        p99, longest = own["p99"] - bare["p99"], own["longest"] - bare["longest"]
        figures += [
            Figure(f"{title}: cycles of the control path, of the bare loop", f"{own['count']}, {bare['count']}"),
            Figure(
                "… 99th percentile of the delay beyond the bare loop's, in ms",
                f"{p99:.2f} (bare {bare['p99']:.2f})",
                f"≤ {MOST_P99_MS:g}" if is_service else "",
                p99 <= MOST_P99_MS or not is_service,
            ),
            Figure(
                "… longest delay beyond the bare loop's, in ms",
                f"{longest:.2f} (bare {bare['longest']:.2f})",
                f"≤ {MOST_STOP_MS:g}" if is_service else "",
                longest <= MOST_STOP_MS or not is_service,
            ),
            Figure(
                "… a bare loop with real-time priority: 99th percentile and longest delay, in ms",
                f"{found['bare_first']['p99']:.2f}, {found['bare_first']['longest']:.2f}",
            ),
        ]
    return figures


BARS = (
    Bar(
        "real-time",
        "Delays of the control path",
        f"A component at {RATE_HZ} Hz in the onboard process of the Pelican, with all its cameras, odometers and the pose fusion "
        f"on {CORES} cores, is hardly later than a loop that only sleeps beside it, at the service's "
        "priority and with no other. The component is required, so that it belongs to the control path. Idle loops keep the cores "
        "of a virtual machine awake, so that its host's time to wake them is not measured, and the simulation yields.",
        run,
    ),
)

if __name__ == "__main__":
    print(json.dumps(measured(float(sys.argv[1]), is_service="--without" not in sys.argv), indent=2))
