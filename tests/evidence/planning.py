"""The vehicle's own map and the ways planned in it: flights behind a wall of boxes, and many rooms without a vehicle."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from tests.evidence.avoidance import on_a_card
from tests.evidence.page import PAGES, Bar, Figure, Progress
from tests.flight import planned
from tests.flight.among_obstacles import HULL_M, box
from tests.flight.card import Card
from tests.onboard.algorithms.scan_matching.rays import Wall
from tests.onboard.algorithms.scan_matching.rays import box as upright
from tests.onboard.components.controllers.test_navigator import GO, ROOM, Voyage

from gloc3.messages.vehicle import PlannedRoute

EXPLORING: Final = range(1, 3)
FLYING: Final = range(1, 3)
ROOMS: Final = range(1, 11)
SEEN: Final = 0.95
WRONG: Final = 0.02
GOALS: Final = ((10.0, 1.0), (16.0, 9.0), (1.0, 10.0), (18.0, 2.0), (0.0, 0.0))
"""In the order in which they are flown to: behind the wall, behind the container's corner, before the wall, and so on."""
PICTURE: Final = "mapping.svg"
OTHER_WALL: Final = (
    box("wall_a", 9.0, 1.0, (0.6, 6.1), 4.0),
    box("wall_b", 9.0, 10.0, (0.6, 4.0), 4.0),
    box("pillar", 4.0, 4.5, (1.2, 1.2), 4.0),
)
APPEARS_AT_S: Final = 3.2
SURE_M: Final = 1.45
"""The planner's 1.3 m, and what the search grants to its cells of 0.2 m."""
Floats = NDArray[np.float64]


def exploring(seed: int) -> dict[str, Any]:
    """The whole hold behind one of two walls of boxes, seen from a height of 1.5 m."""
    boxes = planned.WALL if seed % 2 else OTHER_WALL

    def fly(card: Card, folder: Path) -> dict[str, Any]:
        ruler = planned.fly(card, {"see": "explore: {height_m: 1.5, speed_m_s: 0.8}"}, folder, boxes, seed=seed)
        maps = card.received["map"]
        found = maps[-1].payload
        if seed == EXPLORING[0]:
            (PAGES / PICTURE).write_text(
                planned.picture(found, planned.trail(ruler), "The hold behind a wall of boxes, as explored, north up")
            )
        gaps_s = [b.t_s - a.t_s for a, b in pairwise(maps)]
        ends = [one.payload.reason for one in card.received["action_status/navigator"] if one.payload.reason]
        return {
            "state": card.state("sweep"),
            "told": ends[-1] if ends else "",
            "middle_m": ruler.nearest.hull_m + HULL_M,
            "flight_s": card.now_s,
            "bytes": max(len(one.payload.cells) for one in maps),
            "period_s": min(gaps_s),
            **planned.agreement(found, folder / "world.yaml")._asdict(),
        }

    return on_a_card(fly)


def flying(seed: int) -> dict[str, Any]:
    """From goal to goal behind the wall."""

    def fly(card: Card, folder: Path) -> dict[str, Any]:
        actions = {f"leg_{number}": planned.go_to(*goal) for number, goal in enumerate(GOALS)}
        ruler = planned.fly(card, actions, folder, seed=seed)
        reached = [card.state(f"sweep.{name}") for name in actions]
        return {
            "reached": reached.count("done"),
            "middle_m": ruler.nearest.hull_m + HULL_M,
            "routes": len(card.received["route"]),
            "flight_s": card.now_s,
        }

    return on_a_card(fly)


def shut(seed: int) -> dict[str, Any]:
    """To a goal to which no way leads."""

    def fly(card: Card, folder: Path) -> dict[str, Any]:
        boxes = (*planned.WALL, planned.SHUT)
        ruler = planned.fly(card, {"out": planned.go_to(*GOALS[0])}, folder, boxes, seed=seed)
        reason = "no way leads to the goal that keeps 1.3 m from everything"
        return {
            "is_told": card.state("sweep") == "failed" and any(reason in event.text for event in card.events),
            "middle_m": ruler.nearest.hull_m + HULL_M,
        }

    return on_a_card(fly)


def room(seed: int, *, has_surprise: bool) -> dict[str, Any]:
    """A room with a wall that has a gap of 4 m, and three boxes; one more box appears on the way to it."""
    random = np.random.default_rng([seed, 7])
    gap_m = float(random.uniform(-6.0, 2.0))
    walls = [*ROOM, *upright(5.0, -8.0, 0.5, gap_m + 8.0), *upright(5.0, gap_m + 4.0, 0.5, 4.0 - gap_m)]
    for north in (8.5, 11.0, 13.5):
        walls += upright(north, float(random.uniform(-6.0, 5.0)), *random.uniform(0.3, 0.8, 2).tolist())
    surprise = upright(2.4, 0.5 * gap_m + 0.7, 0.6, 0.6) if has_surprise else []

    def around(now_s: float) -> list[Wall]:
        return [*walls, *(surprise if now_s > APPEARS_AT_S else [])]

    voyage = Voyage(around)
    goal = clear_of((12.5, float(random.uniform(-4.0, 4.0)), -2.0), walls)
    status = voyage.fly(replace(GO, waypoints_ned_m=(goal,)), 120.0)
    return {
        "state": str(status.state),
        "reason": status.reason,
        "can": can_be_reached(goal, [*walls, *surprise]),
        "away_m": math.dist(voyage.at, goal),
        "middle_m": voyage.nearest_m,
        "routes": len(voyage.planner.all(PlannedRoute)),
    }


def clear_of(goal: tuple[float, float, float], walls: Sequence[Wall]) -> tuple[float, float, float]:
    """The place behind the wall that is nearest to a goal and keeps 1.7 m from all walls."""
    north, east = np.meshgrid(np.arange(7.5, 15.0, 0.25), np.arange(-6.5, 6.6, 0.25), indexing="ij")
    away = np.where(_gaps_m(north, east, walls) > 1.7, np.hypot(north - goal[0], east - goal[1]), np.inf)
    best = np.unravel_index(np.argmin(away), away.shape)
    return (float(north[best]), float(east[best]), goal[2])


def can_be_reached(goal: tuple[float, float, float], walls: Sequence[Wall]) -> bool:
    """Whether a way leads there that keeps `SURE_M` from all walls."""
    from scipy.ndimage import label

    rows, columns = np.arange(-4.0, 16.0, 0.1), np.arange(-8.0, 8.0, 0.1)
    north, east = np.meshgrid(rows, columns, indexing="ij")
    labels, _ = label(_gaps_m(north, east, walls) >= SURE_M)
    start, end = (labels[np.argmin(abs(rows - n)), np.argmin(abs(columns - e))] for n, e in ((0.0, 0.0), goal[:2]))
    return bool(start and start == end)


def _gaps_m(north: Floats, east: Floats, walls: Sequence[Wall]) -> Floats:
    least = np.full(north.shape, np.inf)
    for (n0, e0), (n1, e1) in walls:
        along_n, along_e = n1 - n0, e1 - e0
        share = np.clip(((north - n0) * along_n + (east - e0) * along_e) / (along_n**2 + along_e**2), 0.0, 1.0)
        least = np.minimum(least, np.hypot(north - n0 - share * along_n, east - e0 - share * along_e))
    return least


def mapping(progress: Progress) -> list[Figure]:
    """Explorations, and their maps beside the truth."""
    found = []
    for seed in EXPLORING:
        progress.report(f"exploring {seed}")
        found.append(progress.part(f"exploring {seed}", partial(exploring, seed)))
    done = sum(run["state"] == "done" and bool(run["told"]) for run in found)
    seen, middle_m = min(run["seen"] for run in found), min(run["middle_m"] for run in found)
    wrong_free, wrong_occupied = (max(run[name] for run in found) for name in ("wrong_free", "wrong_occupied"))
    kilobytes, period_s = max(run["bytes"] for run in found) / 1000.0, min(run["period_s"] for run in found)
    longest_s = max(run["flight_s"] for run in found)
    return [
        Figure("explorations flown to their end", f"{done} of {len(found)}", "all", done == len(found)),
        Figure("floor that can be reached, of that seen, worst seed", f"{seen:.1%}", f"≥ {SEEN:.0%}", seen >= SEEN),
        Figure("… the longest flight", f"{longest_s:.0f} s"),
        Figure(
            "… the vehicle's middle to the nearest thing",
            f"{middle_m:.2f} m",
            f"≥ {planned.KEEP_M:g} m",
            middle_m >= planned.KEEP_M,
        ),
        Figure("free cells inside something, worst seed", f"{wrong_free:.2%}", f"≤ {WRONG:.0%}", wrong_free <= WRONG),
        Figure(
            "occupied cells more than 0.2 m from anything",
            f"{wrong_occupied:.2%}",
            f"≤ {WRONG:.0%}",
            wrong_occupied <= WRONG,
        ),
        Figure("largest report of the map", f"{kilobytes:.0f} kB", "≤ 100 kB", kilobytes <= 100.0),
        Figure("… shortest time between two", f"{period_s:.2f} s", "≥ 0.9 s", period_s >= 0.9),
    ]


def planning(progress: Progress) -> list[Figure]:
    """ShortestPaths to goals: in flight, and in many rooms."""
    parts: dict[str, list[dict[str, Any]]] = {}
    runs: dict[str, tuple[Callable[[int], dict[str, Any]], Sequence[int]]] = {
        "flying": (flying, FLYING),
        "shut": (shut, FLYING[:1]),
        "room": (partial(room, has_surprise=False), ROOMS),
        "surprise": (partial(room, has_surprise=True), ROOMS),
    }
    for name, (work, seeds) in runs.items():
        parts[name] = []
        for seed in seeds:
            progress.report(f"{name} {seed}")
            parts[name].append(progress.part(f"{name} {seed}", partial(work, seed)))
    return [*_flights(parts["flying"], parts["shut"]), *_rooms(parts["room"], parts["surprise"])]


def _flights(flown: list[dict[str, Any]], barred: list[dict[str, Any]]) -> list[Figure]:
    reached, wanted = sum(run["reached"] for run in flown), len(GOALS) * len(flown)
    middle_m, told = min(run["middle_m"] for run in [*flown, *barred]), sum(run["is_told"] for run in barred)
    return [
        Figure("in the hold behind a wall of boxes: goals reached", f"{reached} of {wanted}", "all", reached == wanted),
        Figure(
            "… the vehicle's middle to the nearest thing",
            f"{middle_m:.2f} m",
            f"≥ {planned.KEEP_M:g} m",
            middle_m >= planned.KEEP_M,
        ),
        Figure("… routes for all of them, most in a flight", str(max(run["routes"] for run in flown))),
        Figure("the gap shut: failed with the reason", f"{told} of {len(barred)}", "all", told == len(barred)),
    ]


def _rooms(rooms: list[dict[str, Any]], surprises: list[dict[str, Any]]) -> list[Figure]:
    figures = []
    least_m = planned.KEEP_M - 0.15
    for name, runs, bar_m in (("rooms", rooms, planned.KEEP_M), ("a box appears on the way", surprises, least_m)):
        can, middle_m = [run for run in runs if run["can"]], min(run["middle_m"] for run in runs)
        done = sum(run["state"] == "done" for run in can)
        others = [run for run in runs if not run["can"]]
        told = sum(run["state"] == "done" or "no way leads" in run["reason"] for run in others)
        again = sum(run["routes"] > 1 for run in runs)
        figures += [
            Figure(
                f"{name}, without a vehicle: goals reached, where gaps of 2.9 m lead there",
                f"{done} of {len(can)}",
                "all",
                done == len(can),
            ),
            Figure(
                f"… with gaps of less than {2.0 * SURE_M:g} m: reached, or failed with the reason",
                f"{told} of {len(others)}",
                "all",
                told == len(others),
            ),
            Figure("… nearest to anything, worst seed", f"{middle_m:.2f} m", f"≥ {bar_m:.2f} m", middle_m >= bar_m),
            Figure("… seeds in which another route was planned", f"{again} of {len(runs)}"),
        ]
    return figures


BARS = (
    Bar(
        "mapping",
        "The vehicle explores the hold and builds a map that agrees with the world",
        "The Pelican explores the cargo hold behind a wall of boxes at a height of 1.5 m, with the simulated scanner, on "
        "JSBSim. The map is compared, cell by cell, with the shape of the world at that height. Reachable is the floor "
        "over which the vehicle's middle can be with 1.3 m to everything, from where it started.",
        mapping,
        seeds=f"{EXPLORING[0]} to {EXPLORING[-1]}",
        pictures=(PICTURE,),
    ),
    Bar(
        "planning",
        "Planned ways reach every goal that can be reached, and keep the margin",
        "Flights of the Pelican in the hold from goal to goal around a wall of boxes; the margin is what the limiter keeps, "
        "1.1 m from the vehicle's middle. Then map, planner, navigator and limiter in rooms at random, with a scanner and a "
        "point that follows 0.3 s late, without a vehicle: alone, and with a box that appears on the way to the gap of the wall.",
        planning,
        seeds=f"{FLYING[0]} to {FLYING[-1]} in flight, {ROOMS[0]} to {ROOMS[-1]} in rooms",
    ),
)
