"""Processes of a patrol killed at random, 200 times in a flight."""

import asyncio
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.hosts.kills import VICTIMS, at_random, fly
from tests.onboard.hosts.kills_told import HEIGHT_M

KILLS = 200
PAUSE_S = (3.0, 9.0)
"""Between two kills."""
AWAY_M = 0.7
LOST_S = 1.0
STANDS_S = 2.5
"""The autopilot takes setpoints that stay away for 0.5 s to be lost; then it brakes from 0.8 m/s with 2.5 m/s², and its
position loop settles within a second."""
STALL_S = 0.5
SEED = 1


def flight(say: Callable[[str], None]) -> dict[str, Any]:
    """The flight."""
    with tempfile.TemporaryDirectory() as folder:
        report = asyncio.run(fly(Path(folder), at_random(SEED, PAUSE_S), KILLS, say))
    return dict(msgspec.to_builtins(report))


def kills(progress: Progress) -> list[Figure]:
    """The figures."""
    found = progress.part("flight", partial(flight, progress.report))
    count = sum(found["kills"].values())
    lowest, highest = found["lowest_m"], found["highest_m"]
    noticed_ms, over_ms = (1e3 * median(found[name]) for name in ("noticed_s", "taken_over_s"))
    is_level = lowest > HEIGHT_M - AWAY_M and highest < HEIGHT_M + AWAY_M
    worst_hold_s = max(found["held_s"])
    outcomes = ", ".join(f"{number} {what}" for what, number in sorted(found["outcomes"].items()))
    return [
        Figure("processes killed by SIGKILL in one flight", str(count), f"≥ {KILLS}", count >= KILLS),
        *(Figure(f"… {name}", str(found["kills"].get(name, 0))) for name in VICTIMS),
        Figure("the flight took, in s", str(found["took_s"])),
        Figure("the mission's end", found["mission"], "done", found["mission"] == "done"),
        Figure("flown along the rounds, in m", str(found["flown_m"]), "≥ 100", found["flown_m"] >= 100.0),
        Figure("most flown back along the way, in m", str(found["most_back_m"]), "< 1.0", found["most_back_m"] < 1.0),
        Figure("height on the way, in m", f"{lowest} to {highest}", f"{HEIGHT_M} ± {AWAY_M}", is_level),
        Figure(
            "farthest from the way, in m; the fence is 2 m from it",
            str(found["farthest_m"]),
            "< 1.0",
            found["farthest_m"] < 1.0,
        ),
        Figure("fastest, in m/s", str(found["fastest_m_s"]), "< 2.0", found["fastest_m_s"] < 2.0),
        Figure("touches down with, in m/s", str(found["touch_down_m_s"]), "< 1.0", found["touch_down_m_s"] < 1.0),
        Figure(
            "longest from the end of the main process until the vehicle stands, in s",
            str(worst_hold_s),
            f"≤ {STANDS_S:g}",
            worst_hold_s <= STANDS_S,
        ),
        Figure(
            "times that the operator said resume, since a component and its standby were away", str(found["resumed"])
        ),
        Figure("commands that he sent meanwhile", f"{sum(found['outcomes'].values())}: {outcomes}"),
        Figure(
            "… executed twice",
            "; ".join(found["twice"]) or "none",
            "none",
            not found["twice"],
        ),
        Figure("logs", str(found["logs"])),
        Figure("… of them unreadable", str(len(found["unreadable"])), "0", not found["unreadable"]),
        Figure(
            "most that a killed main process's log lacks, in s",
            str(found["most_lost_s"]),
            f"≤ {LOST_S:g}",
            found["most_lost_s"] <= LOST_S,
        ),
        Figure(
            "from a child's end to the status that tells it, median, in ms",
            f"{noticed_ms:.0f}",
            "≤ 100",
            noticed_ms <= 100.0,
        ),
        Figure("from there to the standby's work, median, in ms", f"{over_ms:.0f}", "≤ 100", over_ms <= 100.0),
        Figure("longest without a command interface, in s", str(found["longest_away_s"])),
        Figure(
            "longest that the process that looks on overslept, in s: this computer had no time",
            str(found["stall_s"]),
            f"< {STALL_S:g}",
            found["stall_s"] < STALL_S,
        ),
    ]


BARS = (
    Bar(
        "kills",
        "A companion that is killed 200 times in one flight finishes its mission safely",
        "A patrol flies with the companion on two hosts: pose and limiter in a child process of the first, their "
        "standbys on the second, in its main process and in a child. An operator in a separate process sends commands "
        "all the time. Whichever process is killed, and however often, the vehicle stays safe, the process comes "
        "back, and the mission continues where it was. A short script restarts main processes, as systemd would; "
        "children are restarted by their host. The mission says `on_restart: continue`; where a component and its "
        "standby are away at once, `then: hold` holds until the operator resumes.",
        kills,
        f"{SEED}: who is killed when",
    ),
)
