"""Controller and limiter among obstacles: boxes on the way, one that crosses it, and walls to keep a distance from."""

import math
from functools import partial
from typing import Any, Final

import numpy as np
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.algorithms.mapping.test_ways_among_obstacles import Chain
from tests.onboard.algorithms.scan_matching.rays import Wall, box

from gloc3.mission.model.arguments import HeadingOrder

SEEDS: Final = 20
LEAST_M: Final = 0.5
WALL_M: Final = 0.15


def among_boxes(seed: int) -> dict[str, Any]:
    """Up and down a room with four boxes at random, and one that crosses."""
    random = np.random.default_rng(seed)
    still = [
        box(float(north), float(random.uniform(-2.0, 2.0)), *random.uniform(0.3, 1.2, 2).tolist())
        for north in (3.5, 7.0, 10.5, 14.0)
    ]
    begin_s, speed_m_s, north = (
        float(random.uniform(2.0, 8.0)),
        float(random.uniform(0.2, 0.6)),
        float(random.uniform(4.0, 12.0)),
    )

    def walls(now_s: float) -> list[Wall]:
        east = 5.5 - speed_m_s * max(0.0, now_s - begin_s)
        moving = box(north, max(east, -5.9), 0.6, 0.6)
        return [*box(-4.0, -6.0, 24.0, 12.0), *(wall for one in still for wall in one), *moving]

    chain = Chain(walls)
    status = chain.fly(((18.0, 0.0, -2.0), (0.0, 0.5, -2.0)), 150.0, speed_m_s=0.8)
    return {"nearest_m": chain.nearest_m, "state": str(status.state), "reason": status.reason}


def along_wall(seed: int) -> dict[str, Any]:
    """Along a wall that does not run as the way does, beginning at another distance."""
    random = np.random.default_rng(seed)
    slope, gap_m = float(random.uniform(-0.06, 0.06)), float(random.uniform(1.2, 2.2))
    wanted_m = float(random.uniform(1.2, 2.0))
    wall: Wall = ((-5.0, gap_m - 5.0 * slope), (30.0, gap_m + 30.0 * slope))
    chain = Chain(lambda _: [wall], yaw_rad=math.pi / 2.0)
    heading = HeadingOrder(mode="fixed", heading_rad=math.pi / 2.0)
    status = chain.fly(((12.0, 0.0, -2.0),), 90.0, speed_m_s=0.5, wall_distance_m=wanted_m, heading=heading)
    square = math.cos(math.atan(slope))
    off = [abs((gap_m + slope * n - e) * square - wanted_m) for n, e, _ in chain.places if n > 1.5]
    return {"off_m": max(off), "state": str(status.state)}


def study(progress: Progress) -> list[Figure]:
    """Bar 5, with the way and the scanner but without the vehicle's dynamics; the flights are shown elsewhere."""
    boxes = [progress.part(f"boxes {seed}", partial(among_boxes, seed)) for seed in range(1, SEEDS + 1)]
    walls = [progress.part(f"wall {seed}", partial(along_wall, seed)) for seed in range(1, SEEDS + 1)]
    nearest_m, off_m = min(run["nearest_m"] for run in boxes), max(run["off_m"] for run in walls)
    ended = [run for run in boxes if run["state"] == "done"]
    explained = [run for run in boxes if run["state"] == "failed" and run["reason"]]
    kept = sum(run["state"] == "done" for run in walls)
    return [
        Figure("nearest to anything, worst seed", f"{nearest_m:.2f} m", f"≥ {LEAST_M:g} m", nearest_m >= LEAST_M),
        Figure("ways flown to their end", f"{len(ended)} of {SEEDS}"),
        Figure("others, failed with a reason", f"{len(explained)}", "all", len(ended) + len(explained) == SEEDS),
        Figure("distance from a wall, largest deviation", f"{off_m:.3f} m", f"≤ {WALL_M:g} m", off_m <= WALL_M),
        Figure("ways along a wall flown to their end", f"{kept} of {SEEDS}", f"{SEEDS}", kept == SEEDS),
    ]


BARS = (
    Bar(
        "obstacles",
        "Waypoint controller and limiter alone keep half a metre from obstacles",
        "Waypoint controller and limiter run with a scanner (360 beams, 10 mm of noise, 12 m) and a point that "
        "follows 0.3 s late, without a vehicle. A room has four boxes at random and one that crosses; walls are up to "
        "3.4° askew.",
        study,
        seeds=f"1 to {SEEDS}",
    ),
)
