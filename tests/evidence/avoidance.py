"""The inspection vehicle in flight: what it keeps from boxes and walls, the lamp lost and found, coverage, a corridor."""

import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from tests.evidence.inspection import BAR as COVERAGE
from tests.evidence.inspection import FOV_SHARE, seen
from tests.evidence.page import Bar, Figure, Progress
from tests.flight import among_obstacles as courses
from tests.flight.card import Card
from tests.flight.test_flying_on_our_own_pose import errors_m

from gloc3_sitl.vehicles import PELICAN

SEEDS = range(1, 21)
OWN = range(1, 21)
"""Flights by all of its own sensors, which cost ten times as much."""
CONTROLS = range(1, 4)
WALL_M = 0.15
POSE_M = 0.15
FOUND_S = 0.5
RATIO = 10.0
IN_THE_AIR_M = 0.5
GLOC3 = str(Path(sys.executable).with_name("gloc3"))


def on_a_card(fly: Callable[[Card, Path], dict[str, Any]]) -> dict[str, Any]:
    """What a flight tells, in the style of PX4."""
    with tempfile.TemporaryDirectory() as name:
        card = Card("px4", Path(name))
        try:
            return fly(card, Path(name))
        finally:
            card.close()


def flown(course: courses.Course, card: Card, folder: Path, **plan: Any) -> tuple[dict[str, Any], courses.Ruler]:
    """Flies a course: how near it came, how it ended, how well the pose was known."""
    ruler = courses.fly(card, course, folder, **plan)
    ends = [event.text for event in card.events if event.text.startswith(("sweep.out failed", "sweep failed"))]
    reason = "; ".join(ends) if card.state("sweep") == "failed" else ""
    found = {
        "hull_m": ruler.nearest.hull_m,
        "at": ruler.nearest.place_m,
        "state": card.state("sweep"),
        "reason": reason,
        "pose_m": max(errors_m(card)),
        "flight_s": card.now_s,
    }
    return found, ruler


def passing(seed: int) -> dict[str, Any]:
    """Among boxes, with a scanner and a pose by satellites."""
    platform = courses.scanner_platform()
    return on_a_card(
        lambda card, folder: flown(courses.among_boxes(seed), card, folder, seed=seed, platform=platform)[0]
    )


def boxes(seed: int) -> dict[str, Any]:
    """Among boxes, by its own sensors; the lamp is hidden on a part of the way."""

    def fly(card: Card, folder: Path) -> dict[str, Any]:
        found, ruler = flown(courses.among_boxes(seed), card, folder, seed=seed)
        fixes = [(each.t_s, each.payload) for each in card.received.get("position_fix/tracker", [])]
        return found | courses.lost_and_found(ruler.in_sight, fixes)

    return on_a_card(fly)


def blind(seed: int) -> dict[str, Any]:
    """The control: without a scanner, the limiter is told of no obstacles."""
    return on_a_card(
        lambda card, folder: flown(courses.among_boxes(seed), card, folder, seed=seed, platform="pelican_rtk")[0]
    )


def barred(seed: int) -> dict[str, Any]:
    """To where no way leads."""
    platform = courses.scanner_platform()
    return on_a_card(
        lambda card, folder: flown(courses.without_a_way(seed), card, folder, seed=seed, platform=platform)[0]
    )


def wall(seed: int) -> dict[str, Any]:
    """Along a wall, with pictures, and the report of them."""
    course = courses.along_the_wall(seed)

    def fly(card: Card, folder: Path) -> dict[str, Any]:
        found, ruler = flown(course.course, card, folder, seed=seed, out=out)
        return found | {"off_m": courses.off_the_wall_m(ruler.places_m, course.distance_m)}

    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "run"
        found = on_a_card(fly)
        if found["state"] != "done":
            return found
        (side := Path(name) / "side.yaml").write_text(courses.SIDE_WORLD)
        limits = ["--cell", "0.1", "--farthest", "6", "--oblique", "68", "--lift", str(PELICAN.foot_depth_m)]
        subprocess.run(
            [GLOC3, "log", "report", str(out), "--wall", courses.WALL_CORNERS, *limits],
            check=True,
            capture_output=True,
        )
        reported = msgspec.json.decode((out / "report/report.json").read_bytes())
        true, narrow = (seen(out / "log.mcap", share, courses.WALL, str(side)) for share in (1.0, FOV_SHARE))
    return found | {"told": reported["coverage"], "true": true, "narrow": narrow, "pictures": reported["pictures"]}


def duct(seed: int) -> dict[str, Any]:
    """Along a corridor: the variance of the laser's motion along it over that across, the smallest in the air."""

    def fly(card: Card, folder: Path) -> dict[str, Any]:
        platform = courses.corridor_platform()
        found, ruler = flown(courses.through_the_duct(seed), card, folder, seed=seed, platform=platform)
        begin_s = next(t_s for t_s, place in ruler.places_m if place[2] > IN_THE_AIR_M)
        reports = [each.payload for each in card.received["odometry/laser"] if each.t_s > begin_s]
        ratios, off_deg = courses.corridor_ratios(reports)
        return found | {"ratio": min(ratios), "off_deg": max(off_deg), "reports": len(ratios)}

    return on_a_card(fly)


def run(progress: Progress) -> list[Figure]:
    """Bar 5, in flights."""
    parts: dict[str, list[dict[str, Any]]] = {}
    flights = {
        "passing": (passing, SEEDS),
        "boxes": (boxes, OWN),
        "wall": (wall, OWN),
        "duct": (duct, OWN),
        "barred": (barred, CONTROLS),
        "blind": (blind, CONTROLS),
    }
    for name, (fly, seeds) in flights.items():
        parts[name] = []
        for seed in seeds:
            progress.report(f"{name} {seed}")
            parts[name].append(progress.part(f"{name} {seed}", partial(fly, seed)))
    return [
        *_among(parts["passing"], "a pose by satellites"),
        *_among(parts["boxes"], "a pose by its own sensors"),
        *_ends(parts["barred"], parts["blind"]),
        *_lamp(parts["boxes"]),
        *_walls(parts["wall"]),
        *_corridor(parts["duct"]),
    ]


def _among(found: list[dict[str, Any]], pose: str) -> list[Figure]:
    hull_m, bar_m = min(run["hull_m"] for run in found), courses.NEAREST_M
    done = sum(run["state"] == "done" for run in found)
    name = f"among boxes, one moving, {pose}, {len(found)} seeds: hull to the nearest thing"
    return [
        Figure(name, f"{hull_m:.2f} m", f"≥ {bar_m:g} m", hull_m >= bar_m),
        Figure("… the vehicle's middle", f"{hull_m + courses.HULL_M:.2f} m"),
        Figure("… ways flown to their end", f"{done} of {len(found)}", "all", done == len(found)),
    ]


def _ends(barred: list[dict[str, Any]], blind: list[dict[str, Any]]) -> list[Figure]:
    reported = [run for run in barred if run["state"] == "failed" and "an obstacle blocks the path" in run["reason"]]
    barred_m, blind_m, bar_m = (
        min(run["hull_m"] for run in barred),
        max(run["hull_m"] for run in blind),
        courses.NEAREST_M,
    )
    return [
        Figure(
            "no way round: failed, and said so",
            f"{len(reported)} of {len(barred)}",
            "all",
            len(reported) == len(barred),
        ),
        Figure("… hull to the nearest thing", f"{barred_m:.2f} m", f"≥ {bar_m:g} m", barred_m >= bar_m),
        Figure("control, nobody tells the limiter: hull, best seed", f"{blind_m:.2f} m", "red", blind_m < bar_m),
    ]


def _lamp(found: list[dict[str, Any]]) -> list[Figure]:
    hidden_s, wrong = min(run["hidden_s"] for run in found), sum(run["wrong"] for run in found)
    late_s, pose_m = max(run["found_s"] for run in found), max(run["pose_m"] for run in found)
    return [
        Figure("lamp hidden from the tracker, in each flight, at least", f"{hidden_s:.1f} s", "≥ 1 s", hidden_s >= 1.0),
        Figure("… positions told of it while it was", str(wrong), "0", wrong == 0),
        Figure("… found again, slowest", f"{late_s:.2f} s", f"≤ {FOUND_S:g} s", late_s <= FOUND_S),
        Figure(
            "… largest error of the pose in any of these flights",
            f"{pose_m:.3f} m",
            f"≤ {POSE_M:g} m",
            pose_m <= POSE_M,
        ),
    ]


def _walls(flown: list[dict[str, Any]]) -> list[Figure]:
    found = [run for run in flown if run["state"] == "done"]
    off_m, hull_m = max(run["off_m"] for run in found), min(run["hull_m"] for run in found)
    errors = [run["told"] / run["true"] - 1.0 for run in found]
    controls = [abs(run["told"] / run["narrow"] - 1.0) for run in found]
    pictures = [run["pictures"] for run in found]
    worst = max(errors, key=abs)
    return [
        Figure("along a wall: largest deviation of the distance", f"{off_m:.3f} m", f"≤ {WALL_M:g} m", off_m <= WALL_M),
        Figure("… ways flown to their end", f"{len(found)} of {len(flown)}", "all", found == flown),
        Figure(
            "… hull to the nearest thing", f"{hull_m:.2f} m", f"≥ {courses.NEAREST_M:g} m", hull_m >= courses.NEAREST_M
        ),
        Figure("… pictures of the front camera in a flight", f"{min(pictures)} to {max(pictures)}"),
        Figure(
            "… coverage told less the true one, of that, worst seed",
            f"{worst:+.1%}",
            f"within {COVERAGE:.0%}",
            abs(worst) <= COVERAGE,
        ),
        Figure(
            f"… control: cameras that see {FOV_SHARE:.0%} as far out, least",
            f"{min(controls):.1%}",
            "red",
            min(controls) > COVERAGE,
        ),
    ]


def _corridor(found: list[dict[str, Any]]) -> list[Figure]:
    ratio, off_deg = min(run["ratio"] for run in found), max(run["off_deg"] for run in found)
    done = sum(run["state"] == "done" for run in found)
    return [
        Figure(
            "in a corridor: laser's variance along over across, least", f"{ratio:.3g}", f"≥ {RATIO:g}", ratio >= RATIO
        ),
        Figure("… its long axis off the corridor's", f"{off_deg:.1f}°", "≤ 10°", off_deg <= 10.0),
        Figure("… ways flown to their end", f"{done} of {len(found)}", "all", done == len(found)),
        Figure("… largest error of the pose", f"{max(run['pose_m'] for run in found):.3f} m"),
    ]


BARS = (
    Bar(
        "avoidance",
        "The inspection vehicle keeps half a metre from obstacles, moving ones included",
        "The Pelican flies on JSBSim among boxes at random places and one that moves across its path. Distances count "
        f"from the hull, a ball of {courses.HULL_M:g} m around the centre that includes the tips of the rotors. A lamp "
        "that is hidden from the tracker is found again. A distance to a wall is kept, and the report of what was "
        "seen of the wall is true. In a corridor the laser odometer reports the direction that it cannot measure.",
        run,
        seeds=f"{SEEDS[0]} to {SEEDS[-1]} among boxes, {OWN[0]} to {OWN[-1]} by its own sensors, controls {CONTROLS[0]} to {CONTROLS[-1]}",
    ),
)
