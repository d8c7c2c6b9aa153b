"""Missions on a busy computer: real autopilots, and the demonstration's three processes, beside loops that never rest.

`python -m tests.evidence.busy NAME…` flies some of them for the commit at hand; the page takes what has been flown.
"""

import os
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Final

import msgspec
from tests.commands.programs import program
from tests.evidence.page import SCRATCH, Bar, Figure, Progress, basis
from tests.onboard.real_journey import mission_for
from tests.onboard.real_px4 import RealPx4
from tests.onboard.real_vehicle import COPTER, ROVER, Vehicle, simulated

from gloc3.log.reader import LogReader
from gloc3_sitl.demo.demo import free_ports

PAGE: Final = "busy"
LOOPS: Final = 4
CORES: Final = 2
ENDS_S: Final = 420.0
INSTANCE: Final = 9
LATE: Final = re.compile(r"pose is back after (\d+\.?\d*) s")
CHANGES: Final = 12
"""Most changes of the autopilot's mode in one mission: it sets off, lands, and waits now and then; it does not flap."""


class Flown(msgspec.Struct, frozen=True):
    """How a mission went."""

    state: str
    last: str
    """The station's last line."""
    late_s: list[float]
    """How late the pose was, each time that the vehicle held for it."""
    missed: int
    """How often setpoints stayed away for 0.5 s."""
    modes: int
    """Changes of the autopilot's mode while it was armed."""
    gap_s: float
    """Longest time between two poses in the log, while it was armed."""


@contextmanager
def busy() -> Iterator[None]:
    """Loops on the cores that all of a flight's programs share; each is a program of its own, as those are."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(before)[:CORES])
    words = [sys.executable, "-c", "while True: pass"]
    loops = [subprocess.Popen(words, stdin=subprocess.DEVNULL, start_new_session=True) for _ in range(LOOPS)]
    try:
        yield
        assert all(loop.poll() is None for loop in loops), "a loop has ended"
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
        os.sched_setaffinity(0, before)


def _flown(out: Path, said: Sequence[str]) -> Flown:
    """What the log and the station tell."""
    with LogReader(out / "log.mcap") as reader:
        texts = [str(entry.envelope.payload.text) for entry in reader.entries("components/*/event", "ci/event")]
        states = [(entry.now_s, entry.envelope.payload) for entry in reader.entries("autopilot")]
        expired = [int(entry.envelope.payload.expired) for entry in reader.entries("driver")]
        poses = [entry.now_s for entry in reader.entries("pose")]
        missions = [str(entry.envelope.payload.state) for entry in reader.entries("ci/mission")]
    armed = [t_s for t_s, state in states if state.is_armed]
    begin_s, end_s = (armed[0], armed[-1]) if armed else (0.0, 0.0)
    modes = [state.mode_name for t_s, state in states if begin_s <= t_s <= end_s]
    under_way = [t_s for t_s in poses if begin_s <= t_s <= end_s]
    return Flown(
        state=missions[-1] if missions else "no mission",
        last=said[-1] if said else "",
        late_s=[float(found[1]) for text in texts if (found := LATE.search(text))],
        missed=max(expired, default=0),
        modes=sum(one != other for one, other in pairwise(modes)),
        gap_s=round(max((other - one for one, other in pairwise(under_way)), default=0.0), 2),
    )


def ardupilot(vehicle: Vehicle, folder: Path) -> Flown:
    """A box inside a fence, and home."""
    (port,) = free_ports(1, socket.SOCK_DGRAM)
    (folder / "mission.yaml").write_text(mission_for(vehicle))
    link = ("--link", f"udpin://127.0.0.1:{port}")
    with simulated(vehicle, folder / "sitl") as lines:
        if vehicle.preset:
            with program(
                "preset", "apply", vehicle.preset, "--autopilot", lines.first, "--yes", folder=folder
            ) as preset:
                assert preset.end() == 0, preset.text
        words = ("onboard", vehicle.platform, "--autopilot", lines.first, "--station", f"udpout://127.0.0.1:{port}")
        with (
            busy(),
            program(*words, "--out", "out", folder=folder) as onboard,
            program("station", "--headless", "--mission", "mission.yaml", *link, folder=folder) as station,
        ):
            try:
                station.end(ENDS_S)
                onboard.interrupt()
                assert onboard.end() == 0, onboard.text
            finally:
                (folder / "station.txt").write_text(station.text)
                (folder / "onboard.txt").write_text(onboard.text)
    return _flown(folder / "out", station.lines)


def px4(folder: Path) -> Flown:
    """Its quadrotor round a corner, and home."""
    with RealPx4(folder, instance=INSTANCE) as firmware:
        firmware.make_platform()
        with busy(), firmware.onboard() as onboard, firmware.station() as station:
            try:
                station.end(ENDS_S)
            finally:
                (folder / "station.txt").write_text(station.text)
                (folder / "onboard.txt").write_text(onboard.text)
    return _flown(folder / "out", station.lines)


def demo(folder: Path) -> Flown:
    """Simulated vehicle with the embedded autopilot, onboard process and station."""
    with busy(), program("demo", "hop", "--platform", "pelican_rtk", "--out", "out", folder=folder) as running:
        try:
            running.end(ENDS_S)
        finally:
            (folder / "station.txt").write_text(running.text)
    return _flown(folder / "out", running.lines)


FLIGHTS: Final[Mapping[str, tuple[str, Callable[[Path], Flown]]]] = {
    "arducopter": ("arducopter", partial(ardupilot, COPTER)),
    "ardurover": ("ardurover", partial(ardupilot, ROVER)),
    "px4 (SIH)": ("px4", px4),
    "gloc3 demo hop": ("", demo),
}
"""By what flies: the program that has to be on PATH, and the flight."""


def make(title: str) -> Flown:
    """One of them; what stopped it stands in the place of its last line."""
    folder = SCRATCH / PAGE / re.sub(r"\W+", "_", title)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        return FLIGHTS[title][1](folder)
    except (AssertionError, subprocess.TimeoutExpired) as error:
        (folder / "problem.txt").write_text(str(error))
        return Flown("not ended", "; ".join(str(error).strip().splitlines()[-2:]), [], 0, 0, 0.0)


def figures_of(title: str, progress: Progress) -> list[Figure]:
    """Its end, and what it had to wait for."""
    binary, _ = FLIGHTS[title]
    if binary and shutil.which(binary) is None:
        return [Figure(title, f"{binary} is not on PATH", "done", is_met=False)]
    flown = msgspec.convert(progress.part(title, partial(make, title)), Flown)
    end = flown.state if flown.state == "done" else f"{flown.state}: {flown.last}"
    held = ", ".join(f"{late_s:g} s" for late_s in flown.late_s) or "never"
    progress.report(f"{title}: {end}; held: {held}")
    return [
        Figure(title, end, "done", flown.state == "done"),
        Figure(f"{title}: held for a late pose, and went on", held),
        Figure(f"{title}: held for missed setpoints", f"{flown.missed} times"),
        Figure(f"{title}: longest time between two poses", f"{flown.gap_s:g} s"),
        Figure(
            f"{title}: changes of the autopilot's mode", str(flown.modes), f"at most {CHANGES}", flown.modes <= CHANGES
        ),
    ]  # fmt: skip


def run(progress: Progress) -> list[Figure]:
    """The figures of all of them."""
    return [figure for title in FLIGHTS for figure in figures_of(title, progress)]


BARS = (
    Bar(
        PAGE,
        "Missions are done on a computer whose cores are all busy",
        f"{LOOPS} endless loops run beside the programs of a flight on {CORES} cores, with the same priority: the "
        "autopilot with its own physics, `gloc3 onboard` and `gloc3 station --headless`, or `gloc3 demo` with its "
        "three programs. When a pose or a setpoint is late, the vehicle holds until it arrives, and the mission "
        "continues.",
        run,
    ),
)


def main(names: Sequence[str]) -> int:
    """Flies those whose titles are given, or all."""
    progress = Progress(PAGE, basis("tests.evidence.busy"))
    figures = [figure for name in names or FLIGHTS for figure in figures_of(name, progress)]
    return 0 if all(figure.is_met for figure in figures) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
