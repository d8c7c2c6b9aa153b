"""One sample of the figures that `make bench` compares, as JSON: of the sources that PYTHONPATH leads to.

Arguments are the names of the figures; without any, all are measured.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Collection
from typing import Final

import msgspec
from tests.benchmarks.parts import FIGURES, best_us, yardstick

FLIGHT: Final = "a flight of the mission hop, all of the program"
MEMORY: Final = "its memory"
LOOP: Final = "a step of a plain Python loop"
UNITS: Final = {FLIGHT: "s", MEMORY: "MB", LOOP: "us", **dict.fromkeys(FIGURES, "us")}


def sample(names: Collection[str]) -> dict[str, float]:
    """The figures of these names, each in its unit; times are of a processor."""
    works = {LOOP: yardstick, **FIGURES}
    found = {name: best_us(work) for name, work in works.items() if name in names}
    if FLIGHT in names or MEMORY in names:
        found[FLIGHT], found[MEMORY] = _flight()
    return found


def _flight() -> tuple[float, float]:
    """Processor seconds and megabytes of a whole program that flies."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "gloc3", "fly", "hop", "--out", folder]
        flight = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, used = os.wait4(flight.pid, 0)
        flight.returncode = os.waitstatus_to_exitcode(status)
    if flight.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {flight.returncode}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss * 1024 / 1e6


if __name__ == "__main__":
    sys.stdout.buffer.write(msgspec.json.encode(sample(sys.argv[1:] or UNITS)))
