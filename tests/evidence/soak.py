"""A day of missions by every platform: memory, handles and threads stay level."""

import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import msgspec
from tests.evidence.page import PAGES, ROOT, Bar, Figure, Progress
from tests.flight.soaking import HOUR_S, Course, Sample, Soaked, slope_per_h, soak

from gloc3.log.report.figure import drawing

HOURS: Final = 24.0
"""Virtual time of each platform."""
SLICE_H: Final = 6.0
"""Of these in one process and one boot. A run that is interrupted begins its last slice again, and no other."""
WARM_H: Final = 1.5
"""Until then caches and stores that keep the last so many become full."""
MOST_MB_H: Final = 0.5
MOST_OBJECTS_H: Final = 500.0
"""Objects that are traced, of some 100,000."""
MOST_HANDLES_H: Final = 0.01
GROUPS: Final = {
    "copters": (
        Course(mission="hop", platform="pelican_rtk", autopilot="px4"),
        Course(mission="hop", platform="pelican_rtk", autopilot="ardupilot"),
        Course(mission="survey", platform="copter"),
    ),
    "wings": (
        Course(mission="mapping", platform="plane"),
        Course(mission="powerline", platform="vtol"),
    ),
    "surface": (
        Course(mission="survey", platform="boat"),
        Course(mission="survey", platform="rover"),
    ),
    "under-water": (
        Course(mission="survey", platform="submarine"),
        Course(mission="survey", platform="auv"),
        Course(mission="survey", platform="rov"),
    ),
}
"""A page each, since a platform takes half an hour of processor time."""


def run_slice(course: Course, number: int) -> None:
    """Soaks in this process; the result goes to stdout, what was measured so far to stderr."""

    def report(soaked: Soaked) -> None:
        print(f"soak: {course}, slice {number + 1}: {soaked.samples[-1]}", file=sys.stderr, flush=True)

    sys.stdout.buffer.write(msgspec.json.encode(soak(course, SLICE_H, report, seed=number)))


def slice_of(course: Course, number: int) -> Any:
    """One slice in a process of its own, whose memory is its own."""
    called = f"run_slice(msgspec.json.decode({msgspec.json.encode(course)!r}, type=Course), {number})"
    program = f"import msgspec; from tests.evidence.soak import Course, run_slice; {called}"
    return msgspec.json.decode(
        subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=True, stdout=subprocess.PIPE).stdout
    )


def judge(group: str) -> Callable[[Progress], Sequence[Figure]]:
    """What gives a few figures for each platform of a group."""

    def run(progress: Progress) -> Sequence[Figure]:
        return _judge(progress, group)

    return run


def _judge(progress: Progress, group: str) -> Sequence[Figure]:
    figures, curves = list[Figure](), dict[str, list[list[Sample]]]()
    for course in GROUPS[group]:
        slices = [
            msgspec.convert(progress.part(f"{course} {number}", partial(slice_of, course, number)), Soaked)
            for number in range(round(HOURS / SLICE_H))
        ]
        figures += _figures(course, slices)
        curves[str(course)] = [one.samples for one in slices]
        progress.report(f"{course}: {sum(one.hours for one in slices):.0f} h")
    _draw(curves, PAGES / _picture(group))
    return figures


def _figures(course: Course, slices: Sequence[Soaked]) -> list[Figure]:
    hours = sum(one.hours for one in slices)
    ends = sum((Counter(one.ends) for one in slices), Counter[str]())
    problems = [problem for one in slices for problem in one.problems]

    def steepest(name: str) -> float:
        return max(slope_per_h(one.samples, name, WARM_H) for one in slices)

    memory, objects = steepest("resident_mb"), steepest("objects")
    handles, threads = steepest("handles"), steepest("threads")
    last = slices[-1].samples[-1]
    return [
        Figure(f"{course}: hours", f"{hours:.1f}", f"≥ {HOURS:g}", hours >= HOURS),
        Figure(
            "… missions",
            ", ".join(f"{count:,} {state}" for state, count in ends.most_common())
            + "".join(f"; {p}" for p in problems[:2]),
            "all done",
            set(ends) == {"done"},
        ),
        Figure(
            "… memory: MB at the end, MB more an hour",
            f"{last.resident_mb:.0f}, {memory:+.2f}",
            f"< {MOST_MB_H:g} an hour",
            memory < MOST_MB_H,
        ),
        Figure(
            "… traced objects: at the end, more an hour",
            f"{last.objects:,}, {objects:+.0f}",
            f"< {MOST_OBJECTS_H:g} an hour",
            objects < MOST_OBJECTS_H,
        ),
        Figure(
            "… handles and threads: at the end, more an hour",
            f"{last.handles} and {last.threads}, {handles:+.3f} and {threads:+.3f}",
            f"< {MOST_HANDLES_H:g} an hour",
            max(handles, threads) < MOST_HANDLES_H,
        ),
        Figure("… processor time, minutes", f"{sum(one.cpu_s for one in slices) / 60.0:.0f}"),
    ]


def _picture(group: str) -> str:
    return f"soak_{group}.svg"


def _draw(curves: dict[str, list[list[Sample]]], file: Path) -> None:
    """Memory and traced objects over the hours, a line for each platform."""
    with drawing(file, 8.0, 4.2) as figure:
        above, below = figure.subplots(2, 1, sharex=True)
        for name, slices in curves.items():
            hours = [one.t_s / HOUR_S + SLICE_H * number for number, samples in enumerate(slices) for one in samples]
            samples = [one for samples in slices for one in samples]
            above.plot(hours, [one.resident_mb for one in samples], linewidth=0.8, label=name)
            below.plot(hours, [one.objects / 1e3 for one in samples], linewidth=0.8)
        above.set_ylabel("memory, MB")
        below.set_ylabel("traced objects, thousands")
        below.set_xlabel("virtual time, h")
        above.legend(fontsize=6.0, ncols=2)


BARS = tuple(
    Bar(
        f"soak-{group}",
        f"A day of missions leaves memory, handles and threads level: {', '.join(dict.fromkeys(c.platform for c in courses))}",
        "Each of these platforms flies, drives or dives one mission after another for "
        f"{HOURS:g} h of virtual time, in {HOURS / SLICE_H:g} boots of {SLICE_H:g} h. The whole stack and its "
        "simulation run in one process, and everything is logged. Each mission has one disturbance: the station's "
        "link, the cable, the station itself, a pause, another program's station that requests everything, or a "
        "component that crashes. Batteries are charged between missions; the store of events is full from the start. "
        f"A line is fitted to memory, traced objects, handles and threads after {WARM_H:g} h of each boot; the "
        "steepest counts.",
        judge(group),
        seeds="0 to 3, one for each boot",
        pictures=(_picture(group),),
    )
    for group, courses in GROUPS.items()
)
