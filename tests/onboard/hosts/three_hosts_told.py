"""What a flight on three hosts was like, from the truth and the logs of the hosts."""

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from math import hypot, inf
from pathlib import Path
from statistics import median
from typing import Any, Final

import msgspec
from tests.flight.fleet_trial import Command
from tests.onboard.hosts.kills_told import touch_down_m_s
from tests.onboard.hosts.namespaces import NETS, VEHICLE

from gloc3.log.reader import LoggedMessage, LogReader
from gloc3.messages.command_interface import Outcome
from gloc3.messages.topics import TopicTable
from gloc3_sitl.flight.messages import TOPICS, SimTruth

HEIGHT_M, LENGTH_M = 1.5, 3.0
STEREO: Final = "stereo"
SOON_S: Final = 1.0
"""What a fault does is seen by then."""


class Trial(msgspec.Struct, frozen=True, kw_only=True):
    """One fault, as it was gone through."""

    name: str
    host: str
    begun_s: float
    """In the platform's time."""
    ended_s: float
    is_lost: bool
    """Whether the host was told to be lost."""
    healed_s: float
    """From the end of the fault until everybody was here; -1 where that took too long."""
    held_at_s: float
    """When the operator said resume; 0 where he had not to."""
    commands: list[Command] = []
    wrong: list[str] = []
    used_s: float = 0.0
    """From the end of the fault until the pose rested on the stereo odometry again; 0 where it did all the while."""


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """How a flight went."""

    mission: str
    odometer: str
    """Its host."""
    start_s: float
    """From the start of all processes until all hosts were here."""
    rate_hz: float
    """Of the stereo odometry as it comes to the vehicle while nothing is wrong."""
    missed: int
    """Gaps in the numbers of these."""
    delay_s: float
    """Median, from the exposure to its arrival at the vehicle."""
    used_share: float
    """Share of the poses of that time that rest on the stereo odometry."""
    clock_bounds_s: dict[str, float]
    """Median, by host."""
    trials: list[Trial]
    moving_m_s: float
    """Fastest when the operator said resume."""
    farthest_m: float
    """From the way, at most, between take-off and landing."""
    touch_down_m_s: float
    """Downward, at most, in the last 0.3 m."""
    twice: list[str]
    """Commands that were not accepted and executed just once."""
    stall_s: float
    """Longest sleep of the process that looks on, beyond what it wanted: this computer had no time."""


def measured(
    folder: Path,
    odometer: str,
    end: str,
    calm: tuple[float, float],
    start_s: float,
    trials: list[Trial],
    stall_s: float,
) -> Report:
    """The report; `calm` is the time without faults, in the platform's time."""
    by_topic: dict[str, list[LoggedMessage]] = {}
    for path in sorted((folder / "out").glob(f"log-{VEHICLE}*.mcap"), key=lambda path: path.stat().st_mtime):
        with LogReader(path) as reader:
            for entry in reader.entries():
                by_topic.setdefault(entry.envelope.topic.partition("/")[2], []).append(entry)
    stereo = [e for e in by_topic.get("odometry/stereo", []) if calm[0] < e.now_s < calm[1]]
    poses: list[tuple[float, bool]] = [(e.now_s, STEREO in e.envelope.payload.sources) for e in by_topic["pose"]]
    in_calm = [is_used for now_s, is_used in poses if calm[0] < now_s < calm[1]]
    bounds = {host: [e.envelope.payload.clock_bound_s for e in by_topic[f"hosts/{host}"]] for host in NETS}
    with LogReader(folder / "truth" / "truth.mcap", TopicTable(TOPICS).types) as reader:
        truth: list[tuple[float, Any]] = [(e.envelope.t_s, e.envelope.payload) for e in reader.entries("sim/truth")]
    holds_s = [trial.held_at_s for trial in trials if trial.held_at_s]
    speeds = [min((abs(t_s - at_s), hypot(*one.velocity_ned_m_s)) for t_s, one in truth)[1] for at_s in holds_s]
    return Report(
        mission=end,
        odometer=odometer,
        start_s=round(start_s, 1),
        rate_hz=round(len(stereo) / (calm[1] - calm[0]), 1),
        missed=sum(max(0, b.envelope.sequence - a.envelope.sequence - 1) for a, b in pairwise(stereo)),
        delay_s=round(median(e.now_s - e.envelope.t_s for e in stereo), 3) if stereo else inf,
        used_share=round(sum(in_calm) / max(1, len(in_calm)), 3),
        clock_bounds_s={host: round(median(found), 5) for host, found in bounds.items()},
        trials=[msgspec.structs.replace(trial, used_s=_used_s(poses, trial)) for trial in trials],
        moving_m_s=round(max(speeds, default=0.0), 2),
        farthest_m=round(_farthest_m(truth), 2),
        touch_down_m_s=touch_down_m_s(truth),
        twice=list(_wrong(trials, by_topic)),
        stall_s=round(stall_s, 2),
    )


def _used_s(poses: list[tuple[float, bool]], trial: Trial) -> float:
    missing_s = (now_s for now_s, is_used in poses if now_s >= trial.begun_s and not is_used)
    since_s = max(trial.ended_s, next(missing_s, inf))
    if since_s > trial.ended_s + SOON_S:
        return 0.0
    return round(next((now_s for now_s, is_used in poses if now_s >= since_s and is_used), inf) - trial.ended_s, 1)


def _farthest_m(truth: list[tuple[float, SimTruth]]) -> float:
    """From the way along x, at its height, between the end of the take-off and the begin of the landing."""
    floor_m = -truth[0][1].position_ned_m[2]
    places = [(x, y, -z - floor_m) for x, y, z in (one.position_ned_m for _, one in truth)]
    high = [i for i, (_, _, height_m) in enumerate(places) if height_m > HEIGHT_M - 0.1]
    return max(
        hypot(max(0.0, -x, x - LENGTH_M), y, max(0.0, abs(height_m - HEIGHT_M) - 0.1))
        for x, y, height_m in places[high[0] : high[-1] + 1]
    )


def _wrong(trials: list[Trial], by_topic: dict[str, list[LoggedMessage]]) -> Iterator[str]:
    functions: list[Any] = [e.envelope.payload for e in by_topic.get("components/viewer/function", [])]
    executed = Counter(one.arguments.get("rate_hz") for one in functions if one.function == "set_rate")
    for trial in trials:
        for command in trial.commands:
            times = executed[command.rate_hz]
            if command.outcome != Outcome.ACCEPTED or times != 1:
                yield f"{command.rate_hz}: {command.outcome} {command.reason}, executed {times} times"
