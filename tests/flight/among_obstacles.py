"""Flights of the Pelican among boxes: worlds and ways by their seed, and how near it truly came to anything."""

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from tests.flight.card import Card
from tests.flight.missions import platform

from gloc3.messages.frames import Vector3
from gloc3.messages.perception import Odometry, PositionFix
from gloc3.platform.reader import whole_text
from gloc3_sitl.world.placing import Placing
from gloc3_sitl.world.world import World

HULL_M = 0.34
"""From the Pelican's middle to the tips of its rotors: an arm of 0.21 m, and half a propeller of 10 inches."""
NEAREST_M = 0.5
"""What is kept between hull and obstacle."""
FLICKER_S = 0.6
"""A lamp that is seen or hidden for less is not judged."""
FRAME_S = 0.15
"""Around the moment at which it is hidden, two frames of the tracker."""
ALONG_FROM_M = 1.0
"""The way along the wall has begun from here on."""


class Course(NamedTuple):
    """What is flown among what."""

    world: str
    """The name of a world, or the text of one."""
    mission: str


def box(
    name: str, x: float, y: float, size: Sequence[float], height_m: float = 3.5, shuttle: str = "", low_m: float = 0.0
) -> str:
    """A box of a world file, by its middle."""
    half_x, half_y = size[0] / 2.0, size[1] / 2.0
    moves = f", shuttle: {{{shuttle}}}" if shuttle else ""
    corners = (
        f"min_m: [{x - half_x:.3f}, {y - half_y:.3f}, {low_m}], max_m: [{x + half_x:.3f}, {y + half_y:.3f}, {height_m}]"
    )
    return f"  {name}: {{{corners}, texture: crate{moves}}}"


def world(boxes: Sequence[str], based_on: str = "hold_busy") -> str:
    """A world file with more boxes."""
    return "\n".join(["world: yard", f"based_on: {based_on}", "boxes:", *boxes]) + "\n"


HOLD = "frame: hold\ngeofence: {polygon_m: [[-2.9, -2.9], [20.9, -2.9], [20.9, 12.9], [-2.9, 12.9]], ceiling_m: 8}"
DUCT = "frame: corridor\ngeofence: {polygon_m: [[-9, -1.2], [30, -1.2], [30, 1.2], [-9, 1.2]], ceiling_m: 2.9}"


def way(waypoints: Sequence[Vector3], speed_m_s: float, more: str = "", *, others: str = "", place: str = HOLD) -> str:
    """A mission: up, along the waypoints, down."""
    places = [[round(part, 3) for part in waypoint] for waypoint in waypoints]
    out = f"{{follow_waypoints: {{waypoints_m: {places}, speed_m_s: {speed_m_s:.2f}{more}}}}}"
    return f"""mission: among obstacles
{place}
on_failure: land
on_link_loss: continue
tasks:
  depart: {{actions: {{climb: {{take_off: {{height_m: {waypoints[0][2]:.2f}}}}}}}}}
  sweep: {{after: [depart], actions: {{out: {out}{others}}}}}
  recover: {{after: [sweep], actions: {{down: {{land: {{}}}}}}}}
"""


PLATE = box("plate", 14.6, -1.2, (0.6, 3.5), 6.6, low_m=6.4)
"""Hangs between the tracker and the way, from where that is about 2.4 m from the start to 5.3 m."""


def among_boxes(seed: int) -> Course:
    """Past two boxes at random, and one that is moved to and fro across the way between them."""
    random = np.random.default_rng([seed, 31])
    height_m, x_m, y_m = (float(random.uniform(*bounds)) for bounds in ((1.2, 2.2), (8.0, 9.0), (-0.5, 3.5)))
    boxes = [PLATE]
    for number, share in enumerate((0.36, 0.78)):
        aside_m, size_m = float(random.uniform(-0.8, 0.8)), random.uniform(0.4, 1.2, 2).tolist()
        boxes.append(box(f"still_{number}", share * x_m, share * y_m + aside_m, size_m))
    side, period_s = float(random.choice((-1.0, 1.0))), float(random.uniform(24.0, 40.0))
    moves = f"by_m: [0, {7.0 * side}, 0], period_s: {period_s:.2f}"
    boxes.append(box("moving", 0.57 * x_m, 3.0 - 3.5 * side, (0.9, 0.9), shuttle=moves))
    return Course(world(boxes), way([(x_m + 1.5, y_m, height_m)], float(random.uniform(0.6, 1.2))))


def without_a_way(seed: int) -> Course:
    """To a place behind a beam from side to side."""
    random = np.random.default_rng([seed, 32])
    x_m, height_m = float(random.uniform(3.5, 5.0)), float(random.uniform(1.5, 1.7))
    boxes = [box("bar", x_m, 5.0, (0.5, 15.98), 2.4, low_m=1.25)]
    return Course(world(boxes, "hold"), way([(x_m + 3.0, float(random.uniform(-0.5, 2.0)), height_m)], 0.8))


class WallCourse(NamedTuple):
    """A flight along the starboard side of the hold, looking at it."""

    course: Course
    distance_m: float
    """That is to be kept, from the vehicle's middle."""


WALL, WALL_Y_M = "starboard", -3.0
WALL_CORNERS = "21,-3,10 -3,-3,10 -3,-3,1.2 21,-3,1.2"
SIDE_WORLD = f"""world: yard
based_on: hold
surfaces:
  {WALL}: {{corner_m: [21, -3, 10], across_m: [-24, 0, 0], down_m: [0, 0, -8.8], texture: side}}
"""
"""The hold, its side without what is behind the slope of the bilge, which no report can know."""


def along_the_wall(seed: int) -> WallCourse:
    """A way that runs up to 4 degrees askew and begins up to 0.4 m too far or too near; pictures every 0.5 m."""
    random = np.random.default_rng([seed, 33])
    distance_m, height_m = float(random.uniform(1.4, 2.2)), float(random.uniform(1.8, 3.0))
    ends = [WALL_Y_M + distance_m + float(random.uniform(-0.4, 0.4)) for _ in range(2)]
    more = f", heading: 90, wall_distance_m: {distance_m:.3f}"
    photos = ", photos: {record_images: {camera: front_left, every_m: 0.5}, until: out}"
    text = way([(0.6, ends[0], height_m), (6.6, ends[1], height_m)], 0.5, more, others=photos)
    return WallCourse(Course(SIDE_WORLD, text), distance_m)


def through_the_duct(seed: int, length_m: float = 5.0) -> Course:
    """Along the duct, by about so much, where a laser scanner cannot tell how far."""
    random = np.random.default_rng([seed, 34])
    places = [
        (length_m + float(random.uniform(-1.0, 1.0)), float(random.uniform(-0.1, 0.1)), float(random.uniform(1.0, 1.6)))
    ]
    return Course("corridor", way(places, float(random.uniform(0.4, 0.8)), place=DUCT))


class Nearest(NamedTuple):
    """How near a flight came to a wall or a box."""

    hull_m: float
    """From its hull, as a ball of `HULL_M` around its middle."""
    t_s: float
    place_m: Vector3


class Ruler:
    """Measures, in a world, how near a vehicle comes to anything but the floor, and whether the tracker could see it."""

    def __init__(self, name: str) -> None:
        loaded = World.load(name).file
        walls = {name: surface for name, surface in loaded.surfaces.items() if name != "floor"}
        self._world = World(msgspec.structs.replace(loaded, surfaces=walls))
        self._placing = Placing(self._world)
        self.nearest = Nearest(float("inf"), 0.0, (0.0, 0.0, 0.0))
        self.places_m: list[tuple[float, Vector3]] = []
        """Times, and where the vehicle's middle was: `[x, y, height]` in the world."""
        self.in_sight: list[tuple[float, bool]] = []
        """Times, and whether the tracker could see the lamp."""

    def poll(self, flight: Card) -> bool:
        """Measures; always true, so that it can be watched."""
        truth, now_s = flight.flight.simulator.truth(), flight.now_s
        place_m = self._placing.body(truth).position_m
        self.places_m.append((now_s, place_m))
        hull_m = self._world.geometry.clearance_m(place_m, now_s) - HULL_M
        if hull_m < self.nearest.hull_m:
            self.nearest = Nearest(hull_m, now_s, place_m)
        tracker = flight.flight.rig.tracker
        if tracker is not None:
            self.in_sight.append((now_s, tracker.is_visible(tracker.light_m(truth), now_s) is not None))
        return True


def fly(flight: Card, course: Course, folder: Path, **plan: Any) -> Ruler:
    """Flies a course until its sweep has ended, whatever its end is."""
    name = course.world
    if "\n" in name:
        name = str(folder / "world.yaml")
        Path(name).write_text(course.world)
    ruler = Ruler(name)
    flight.begin(course.mission, world=name, **{"platform": "pelican", **plan})
    flight.until(lambda: ruler.poll(flight) and flight.state("sweep") not in ("waiting", "running"), 120.0, "an end")
    return ruler


def lost_and_found(
    in_sight: Sequence[tuple[float, bool]], fixes: Sequence[tuple[float, PositionFix]]
) -> dict[str, float]:
    """How long the lamp was hidden, how many fixes were told meanwhile, and how soon there were fixes again, in seconds."""
    changes = [(t_s, now) for (_, before), (t_s, now) in pairwise(in_sight) if before != now]
    spans = [(begin_s, end_s, now) for (begin_s, now), (end_s, _) in pairwise([*changes, (in_sight[-1][0], False)])]
    valid = [t_s for t_s, fix in fixes if fix.is_valid]
    hidden = [(begin_s, end_s) for begin_s, end_s, now in spans if not now and end_s - begin_s > FLICKER_S]
    shown = [(begin_s, end_s) for begin_s, end_s, now in spans if now and end_s - begin_s > FLICKER_S]
    wrong = sum(begin_s + FRAME_S < t_s < end_s - FRAME_S for t_s in valid for begin_s, end_s in hidden)
    later = [min((t_s for t_s in valid if t_s >= begin_s), default=math.inf) - begin_s for begin_s, _ in shown]
    return {
        "hidden_s": max((end_s - begin_s for begin_s, end_s in hidden), default=0.0),
        "wrong": wrong,
        "found_s": max(later, default=math.inf),
    }


def off_the_wall_m(places_m: Sequence[tuple[float, Vector3]], distance_m: float) -> float:
    """The largest deviation from a distance to the starboard side, once the way along it has begun; infinite if it never has."""
    return max([abs(y - WALL_Y_M - distance_m) for _, (x, y, _) in places_m if x > ALONG_FROM_M], default=math.inf)


def corridor_ratios(reports: Sequence[Odometry]) -> tuple[list[float], list[float]]:
    """Of each valid motion the variance in its least known direction over that across, and how far that is off north, in
    degrees. The vehicle looks north."""
    ratios, off = [], []
    for report in reports:
        if report.is_valid:
            values, axes = np.linalg.eigh(np.array(report.covariance).reshape(6, 6)[:2, :2])
            ratios.append(float(values[1] / values[0]))
            off.append(math.degrees(math.atan2(abs(axes[1, 1]), abs(axes[0, 1]))))
    return ratios, off


def corridor_platform() -> str:
    """The Pelican in the duct, where no tracker stands."""
    return _pelican({"  hold: {origin": "  corridor: {origin"})


def scanner_platform() -> str:
    """The Pelican that flies by satellites, which costs a tenth, with a laser scanner and a limiter that is told."""
    rows = whole_text("pelican").splitlines()
    rows = [row for row in rows if row.startswith(("  - {name: laser,", "  - {name: obstacles,"))]
    assert len(rows) == 2
    return platform({"obstacles: [], ": "", "  - {name: pose,": "\n".join([*rows, "  - {name: pose,"])})


def _pelican(changes: dict[str, str]) -> str:
    text = whole_text("pelican")
    for previous, new in {"platform: pelican": "platform: heron", **changes}.items():
        assert previous in text, previous
        text = text.replace(previous, new)
    return text
