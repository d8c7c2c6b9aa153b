"""Processes of the onboard side killed at random, 200 times in a flight."""

import asyncio
import random
import tempfile
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.nodes.kills import CHILDREN, HEIGHT_M, MAIN, fly

KILLS = 200
A_FLIGHT = 70
"""Kills in a flight, unless it ends before by its policy."""
MOST_FLIGHTS = 12
PAUSE_S = (2.0, 6.0)
"""Between two kills."""
LOST_S = 1.0


def flight(seed: int, progress: Progress) -> dict[str, Any]:
    """One flight."""
    victims = random.Random(seed).choices((MAIN, *CHILDREN), k=A_FLIGHT)
    with tempfile.TemporaryDirectory() as folder:
        report = asyncio.run(fly(Path(folder), victims, seed, PAUSE_S, progress.say))
    return dict(msgspec.to_builtins(report))


def kills(progress: Progress) -> list[Figure]:
    """Flights until enough processes have been killed."""
    found: list[dict[str, Any]] = []
    while sum(sum(one["kills"].values()) for one in found) < KILLS and len(found) < MOST_FLIGHTS:
        seed = len(found) + 1
        found.append(progress.part(f"flight {seed}", partial(flight, seed, progress)))
    count = sum(sum(one["kills"].values()) for one in found)
    done = sum(one["mission"] == "done" for one in found)
    lowest, highest = min(one["lowest_m"] for one in found), max(one["highest_m"] for one in found)
    away, back, lost = (max(one[name] for one in found) for name in ("farthest_m", "most_back_m", "most_lost_s"))
    unreadable = sum(len(one["unreadable"]) for one in found)
    noticed_ms, over_ms = (
        1e3 * median(t for one in found for t in one[name]) for name in ("noticed_s", "taken_over_s")
    )
    is_level = lowest > HEIGHT_M - 0.7 and highest < HEIGHT_M + 0.7
    return [
        Figure("processes killed by SIGKILL in flight", str(count), f"≥ {KILLS}", count >= KILLS),
        *(Figure(f"… {name}", str(sum(one["kills"].get(name, 0) for one in found))) for name in (MAIN, *CHILDREN)),
        Figure("flights", str(len(found))),
        Figure("… whose mission was flown to its end", str(done)),
        Figure("… that landed by `on_failure`: a component and its standby were away at once", str(len(found) - done)),
        Figure("… in which an operator had to say resume", str(sum(one["resumed"] > 0 for one in found))),
        Figure("height on the way, in m", f"{lowest} to {highest}", f"{HEIGHT_M} ± 0.7", is_level),
        Figure("farthest from the way, in m", str(away), "< 1.0", away < 1.0),
        Figure("most flown back along the way, in m", str(back), "< 1.0", back < 1.0),
        Figure("logs", str(sum(one["logs"] for one in found))),
        Figure("… of them unreadable", str(unreadable), "0", not unreadable),
        Figure("most that a killed main process's log lacks, in s", str(lost), f"≤ {LOST_S:g}", lost <= LOST_S),
        Figure(
            "from a child's end to the status that tells it, median, in ms",
            f"{noticed_ms:.0f}",
            "≤ 100",
            noticed_ms <= 100.0,
        ),
        Figure("from there to the standby's work, median, in ms", f"{over_ms:.0f}", "≤ 100", over_ms <= 100.0),
        Figure("longest without a command interface, in s", str(max(one["longest_away_s"] for one in found))),
    ]


BARS = (
    Bar(
        "kills",
        "Processes that are killed in flight",
        "Whichever of its processes is killed, and however often, the vehicle stays safe, the process comes back, and the "
        "mission goes on where it was, or it lands by policy. The main process is started again by a few lines, as systemd "
        "would.",
        kills,
        "1, 2, 3… for each flight: who is killed when",
    ),
)
