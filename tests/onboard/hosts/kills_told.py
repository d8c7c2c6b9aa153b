"""What a patrol among kills was like, from the truth, the logs of all processes and what the operator was told."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import pairwise
from math import hypot, inf
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
from tests.flight.fleet_trial import Command

from gloc3.component.lci import OPERATING, State
from gloc3.errors import Gloc3Error
from gloc3.log.reader import LoggedMessage, LogReader
from gloc3.messages.envelope import ComponentStatus
from gloc3.messages.topics import TopicTable
from gloc3_sitl.flight.messages import TOPICS, SimTruth

HEIGHT_M: Final = 1.5
SIDE_M: Final = 4.0
STANDING_M_S: Final = 0.2
NEAR_GROUND_M: Final = 0.3
STANDBYS: Final = {
    "pose": "pose_standby",
    "pose_standby": "pose",
    "limiter": "limiter_standby",
    "limiter_standby": "limiter",
}


class Kill(NamedTuple):
    """One process, killed."""

    t_s: float
    """In the platform's time."""
    victim: str


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """How it went."""

    kills: dict[str, int]
    """By process."""
    mission: str
    """How it ended."""
    took_s: float
    lowest_m: float
    """Height between the end of the take-off and the begin of the landing."""
    highest_m: float
    farthest_m: float
    """From the ways between the corners, over ground."""
    fastest_m_s: float
    touch_down_m_s: float
    """Downward, at most, in the last 0.3 m."""
    flown_m: float
    """Along the rounds."""
    most_back_m: float
    """How far it flew back along its way at most."""
    held_s: list[float]
    """From each end of the main process until the vehicle stands."""
    resumed: int
    """How often the operator said resume: pose or limiter and their standbys were away at once."""
    logs: int
    unreadable: list[str]
    most_lost_s: float
    """Longest time before a kill of which the main process's log tells nothing."""
    longest_away_s: float
    """Longest time without a summary of the command interface."""
    noticed_s: list[float]
    """From the kill of a child to the first status that says so, of each; without those that were beginning."""
    taken_over_s: list[float]
    """From there to the standby's work, of each."""
    outcomes: dict[str, int]
    """Commands that an operator sent meanwhile, by what he was told of them; `killed` where he was killed before."""
    twice: list[str]
    """Commands that were passed to a component, or reached it, more than once."""
    stall_s: float
    """Longest sleep of the process that looks on, beyond what it wanted: this computer had no time."""


def measured(
    folder: Path, killed: list[Kill], end: str, took_s: float, reported: Sequence[str], stall_s: float
) -> Report:
    """The report.

    Args:
        folder: of the flight.
        killed: in order.
        end: of the mission.
        took_s: from the first round to the end.
        reported: the operator's lines.
        stall_s: see `Report`.
    """
    unreadable: list[str] = []
    mains: list[list[LoggedMessage]] = []
    executed: dict[str, Counter[float]] = {}
    logs = sorted((folder / "out").glob("log*.mcap"), key=lambda path: path.stat().st_mtime)
    for path in logs:
        try:
            with LogReader(path) as reader:
                entries = list(reader.entries())
        except Gloc3Error as error:
            unreadable.append(f"{path.name}: {error}")
            continue
        process = re.sub(r"-\d+$", "", path.stem.removeprefix("log-"))
        executed.setdefault(process, Counter()).update(_rates(entries))
        if process == "vehicle" and entries:
            mains.append(entries)
    noticed_s: list[float] = []
    taken_over_s: list[float] = []
    for entries in mains:
        statuses = [(e.now_s, e.envelope.payload) for e in entries if e.envelope.topic.endswith("/status")]
        _look_at_faults(statuses, killed, noticed_s, taken_over_s)
    kills_s = [kill.t_s for kill in killed if kill.victim == "vehicle"]
    ends_s = [max(e.now_s for e in entries) for entries in mains]
    lost_s = [min((t_s for t_s in kills_s if t_s >= end_s), default=end_s) - end_s for end_s in ends_s]
    summaries_s = sorted(
        e.envelope.t_s for entries in mains for e in entries if e.envelope.topic.endswith("/ci/summary")
    )
    resumed, commands = _commands(reported)
    with LogReader(folder / "truth" / "truth.mcap", TopicTable(TOPICS).types) as reader:
        truth = [(e.envelope.t_s, e.envelope.payload) for e in reader.entries("sim/truth")]
    return Report(
        kills=dict(Counter(kill.victim for kill in killed)),
        mission=end,
        took_s=round(took_s, 1),
        **_flight(truth),
        held_s=[round(_until_standing_s(truth, t_s), 1) for t_s in kills_s],
        resumed=resumed,
        logs=len(logs),
        unreadable=unreadable,
        most_lost_s=round(max(lost_s, default=0.0), 2),
        longest_away_s=round(max((b - a for a, b in pairwise(summaries_s)), default=0.0), 2),
        noticed_s=noticed_s,
        taken_over_s=taken_over_s,
        outcomes=dict(Counter(command.outcome or "killed" for command in commands.values())),
        twice=list(_twice(commands, executed)),
        stall_s=round(stall_s, 2),
    )


def _rates(entries: list[LoggedMessage]) -> Iterator[float]:
    """The rates that components were told to have."""
    for entry in entries:
        payload: Any = entry.envelope.payload
        if entry.envelope.topic.endswith("/function") and payload.function == "set_rate":
            yield payload.arguments["rate_hz"]


def _commands(reported: Sequence[str]) -> tuple[int, dict[float, Command]]:
    """How often an operator said resume, and his commands by their rates, with what he was told of them last."""
    resumed, commands = 0, {}
    for line in reported:
        with suppress(msgspec.MsgspecError):  # half a line, of one who was killed
            text = msgspec.json.decode(line)
            if isinstance(text, str):
                resumed += 1
            else:
                command = msgspec.convert(text, Command)
                commands[command.rate_hz] = command
    return resumed, commands


def _twice(commands: dict[float, Command], executed: dict[str, Counter[float]]) -> Iterator[str]:
    for command in commands.values():
        for process, rates in executed.items():
            if rates[command.rate_hz] > 1:
                yield f"{command.rate_hz} was executed {rates[command.rate_hz]} times in {process}"


def _flight(truth: list[tuple[float, SimTruth]]) -> dict[str, float]:
    floor_m = -truth[0][1].position_ned_m[2]
    heights = [-one.position_ned_m[2] - floor_m for _, one in truth]
    up = next(i for i, height in enumerate(heights) if height > HEIGHT_M - 0.1)
    down = max(i for i, height in enumerate(heights) if height > HEIGHT_M - 0.2)
    flown = [one for _, one in truth[up : down + 1]]
    back_m, along_m = _along([one.position_ned_m for one in flown])
    return {
        "lowest_m": round(min(heights[up : down + 1]), 2),
        "highest_m": round(max(heights), 2),
        "farthest_m": round(max(_away_m(one.position_ned_m) for one in flown), 2),
        "fastest_m_s": round(max(max(abs(v) for v in one.velocity_ned_m_s) for one in flown), 2),
        "touch_down_m_s": touch_down_m_s(truth),
        "flown_m": round(along_m, 1),
        "most_back_m": round(back_m, 2),
    }


def touch_down_m_s(truth: list[tuple[float, SimTruth]]) -> float:
    """The fastest downward in the last 0.3 m of a flight; infinite where it does not end on the ground."""
    floor_m = -truth[0][1].position_ned_m[2]
    heights = [-one.position_ned_m[2] - floor_m for _, one in truth]
    down = max(i for i, height in enumerate(heights) if height > NEAR_GROUND_M)
    return round(max((one.velocity_ned_m_s[2] for _, one in truth[down + 1 :]), default=inf), 2)


def _until_standing_s(truth: list[tuple[float, SimTruth]], kill_s: float) -> float:
    slow_s = (t_s for t_s, one in truth if t_s >= kill_s and hypot(*one.velocity_ned_m_s) < STANDING_M_S)
    return next(slow_s, inf) - kill_s


def _look_at_faults(
    statuses: list[tuple[float, ComponentStatus]],
    killed: list[Kill],
    noticed_s: list[float],
    taken_over_s: list[float],
) -> None:
    """How soon the ends of children were seen in one life of the main process, and their standbys at work."""
    known: dict[str, State | None] = {}
    for now_s, status in statuses:
        was, known[status.name] = known.get(status.name), status.state
        if status.state is not State.FAULTY or was not in OPERATING:
            continue
        kills_s = [
            kill.t_s
            for kill in killed
            if kill.t_s <= now_s and f"process {kill.victim.partition('/')[2]} ended" in status.cause
        ]
        if not kills_s:
            continue
        noticed_s.append(round(now_s - max(kills_s), 3))
        other = STANDBYS.get(status.name)
        if was is State.WORKING and other is not None and known.get(other) is State.QUIET:
            up_s = (t_s for t_s, one in statuses if t_s >= now_s and one.name == other and one.state is State.WORKING)
            taken_over_s.append(round(next(up_s, inf) - now_s, 3))


def _away_m(place: tuple[float, float, float]) -> float:
    """How far a place is from the box's sides, over ground; x is north, y to the left of it."""
    x, y = place[0], -place[1]
    outside = max(-x, x - SIDE_M, -y, y - SIDE_M)
    return outside if outside > 0.0 else min(x, SIDE_M - x, y, SIDE_M - y)


def _round_m(place: tuple[float, float, float]) -> float:
    """How far along the box's sides a place is, 0 to four of them."""
    x, y = min(SIDE_M, max(0.0, place[0])), min(SIDE_M, max(0.0, -place[1]))
    _, along = min((y, x), (SIDE_M - x, SIDE_M + y), (SIDE_M - y, 3.0 * SIDE_M - x), (x, 4.0 * SIDE_M - y))
    return along


def _along(places: Sequence[tuple[float, float, float]]) -> tuple[float, float]:
    """How far behind the farthest place along the rounds a later one was at most, and how far it went."""
    total = farthest = most = 0.0
    for before, after in pairwise(map(_round_m, places)):
        total += (after - before + 2.0 * SIDE_M) % (4.0 * SIDE_M) - 2.0 * SIDE_M
        farthest = max(farthest, total)
        most = max(most, farthest - total)
    return most, farthest
