"""Processes of the onboard side killed at random, 200 times in a flight."""

import asyncio
import random
import tempfile
from pathlib import Path
from typing import Any

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.nodes.kills import CHILDREN, HEIGHT_M, MAIN, fly

KILLS = 200
SEED = 1
PAUSE_S = (1.0, 6.0)
"""Between two kills: a process takes some seconds to come back, so that some are killed while others are away."""
LOST_S = 1.0


def flight(progress: Progress) -> dict[str, Any]:
    """One flight."""
    victims = random.Random(SEED).choices((MAIN, *CHILDREN), k=KILLS + KILLS // 4)
    with tempfile.TemporaryDirectory() as folder:
        report = asyncio.run(fly(Path(folder), victims, SEED, PAUSE_S, progress.say, most=KILLS))
    return dict(msgspec.to_builtins(report))


def kills(progress: Progress) -> list[Figure]:
    """The figures of the flight."""
    found = progress.part("flight", lambda: flight(progress))
    count = sum(found["kills"].values())
    heights = f"{found['lowest_m']} to {found['highest_m']}"
    is_high = found["lowest_m"] > HEIGHT_M - 0.7 and found["highest_m"] < HEIGHT_M + 0.7
    return [
        Figure("processes killed by SIGKILL in the flight", str(count), f"≥ {KILLS}", count >= KILLS),
        *(Figure(f"… {name}", str(number)) for name, number in sorted(found["kills"].items())),
        Figure("the mission's end", found["mission"], "done", found["mission"] == "done"),
        Figure("how often an operator had to say resume", str(found["resumed"]), "0", found["resumed"] == 0),
        Figure("flight, in s", str(found["took_s"])),
        Figure("height on the way, in m", heights, f"{HEIGHT_M} ± 0.7", is_high),
        Figure("farthest from the way, in m", str(found["farthest_m"]), "< 1.0", found["farthest_m"] < 1.0),
        Figure("most flown back along the way, in m", str(found["most_back_m"]), "< 1.0", found["most_back_m"] < 1.0),
        Figure("logs", str(found["logs"])),
        Figure("… of them unreadable", str(len(found["unreadable"])), "0", not found["unreadable"]),
        Figure(
            "most that a killed main process's log lacks, in s",
            str(found["most_lost_s"]),
            f"≤ {LOST_S:g}",
            found["most_lost_s"] <= LOST_S,
        ),
        Figure("longest without a command interface, in s", str(found["longest_away_s"])),
    ]


BARS = (
    Bar(
        "kills",
        "Processes that are killed in flight",
        "Whichever of its processes is killed, and however often, the vehicle stays safe, the process comes back, and the "
        "mission goes on where it was. The main process is started again by a loop of five lines, as systemd would.",
        kills,
        f"{SEED} of who is killed when",
    ),
)
