"""Flights in the hold behind a wall of boxes, by the vehicle's own map, and what the world's truth says about them."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tests.flight import among_obstacles as courses
from tests.flight.card import Card
from tests.flight.missions import platform

from gloc3.messages.perception import CELL_FREE, CELL_OCCUPIED, OccupancyMap
from gloc3.platform.reader import whole_text
from gloc3_sitl.world.world import World

HEIGHT_M = 1.5
KEEP_M = 1.1
"""What the limiter keeps, from the vehicle's middle: the margin."""
PLANNED_M = 1.3
"""What the planner keeps."""
WALL = (
    courses.box("wall_a", 6.0, -0.55, (0.6, 3.0), 4.0),
    courses.box("wall_b", 6.0, 3.5, (0.6, 5.0), 4.0),
    courses.box("wall_c", 6.0, 10.8, (0.6, 2.4), 4.0),
)
"""Across the hold, with a gap of 3.6 m at its port side."""
SHUT = courses.box("door", 6.0, 7.8, (0.6, 3.55), 4.0)
"""Closes the gap."""
_ROWS = ("laser", "obstacles", "map", "planner", "navigator")
_CAPABILITIES = ("find_way", "explore")
_OWNERS = "setpoint_wanted/waypoints, setpoint_wanted/hold"

Mask = NDArray[np.bool_]


def mapping_platform() -> str:
    """The Pelican that flies by satellites, which costs a tenth, with a scanner, a map and a planner."""
    lines = whole_text("pelican").splitlines()
    rows = [row for row in lines if row.startswith(tuple(f"  - {{name: {name}," for name in _ROWS))]
    abilities = [row for row in lines if row.startswith(tuple(f"  {name}:" for name in _CAPABILITIES))]
    assert (len(rows), len(abilities)) == (len(_ROWS), len(_CAPABILITIES))
    changes = {
        "obstacles: [], ": "",
        "  - {name: pose,": "\n".join([*rows, "  - {name: pose,"]),
        _OWNERS: _OWNERS.replace("waypoints, ", "waypoints, setpoint_wanted/navigator, "),
        "  land: {": "\n".join([*abilities, "  land: {"]),
    }
    return platform(changes)


def mission(actions: Mapping[str, str]) -> str:
    """Up, one action after the other, down."""
    names = list(actions)
    after = {name: f", after: [{names[index - 1]}]" if index else "" for index, name in enumerate(names)}
    rows = ", ".join(f"{name}: {{{text}{after[name]}}}" for name, text in actions.items())
    return f"""mission: behind the wall
{courses.HOLD}
on_failure: land
on_link_loss: continue
tasks:
  depart: {{actions: {{climb: {{take_off: {{height_m: {HEIGHT_M}}}}}}}}}
  sweep: {{after: [depart], actions: {{{rows}}}}}
  recover: {{after: [sweep], actions: {{down: {{land: {{}}}}}}}}
"""


def go_to(x: float, y: float, speed_m_s: float = 0.8) -> str:
    """A planned way to a place."""
    return f"go_to: {{position_m: [{x}, {y}, {HEIGHT_M}], plan: true, speed_m_s: {speed_m_s}}}"


def fly(
    flight: Card, actions: Mapping[str, str], folder: Path, boxes: Sequence[str] = WALL, **plan: Any
) -> courses.Ruler:
    """Flies actions behind a wall of boxes until they have ended, whatever their end is."""
    name = str(folder / "world.yaml")
    Path(name).write_text(courses.world(boxes, "hold"))
    ruler = courses.Ruler(name)
    flight.begin(mission(actions), world=name, **{"platform": mapping_platform(), **plan})
    flight.until(lambda: ruler.poll(flight) and flight.state("sweep") not in ("waiting", "running"), 400.0, "an end")
    return ruler


class Agreement(NamedTuple):
    """A map beside the world's truth at the height of the flight."""

    seen: float
    """Share of the floor over which the vehicle can be, from where it started, that the map calls free."""
    wrong_free: float
    """Share of the map's free cells that are inside something."""
    wrong_occupied: float
    """Share of the map's occupied cells that are farther than two cells from anything."""


def agreement(found: OccupancyMap, world_file: Path) -> Agreement:
    """How well a map agrees with a world whose frame is the map's."""
    from scipy.ndimage import label

    world = World.load(str(world_file))
    free, occupied = states(found)
    north = found.corner_ne_m[0] + (np.arange(found.rows) + 0.5) * found.cell_m
    east = found.corner_ne_m[1] + (np.arange(found.columns) + 0.5) * found.cell_m
    gap_m = np.array([[world.geometry.clearance_m((n, -e, HEIGHT_M), 0.0) for e in east] for n in north])
    gap_m[(north < -3.0) | (north > 21.0)] = 0.0
    gap_m[:, (east < -13.0) | (east > 3.0)] = 0.0
    labels, _ = label(gap_m >= PLANNED_M)
    start = labels[int(-found.corner_ne_m[0] / found.cell_m), int(-found.corner_ne_m[1] / found.cell_m)]
    reachable = labels == start
    return Agreement(
        seen=float((reachable & free).sum() / reachable.sum()),
        wrong_free=float((free & (gap_m <= 0.0)).sum() / free.sum()),
        wrong_occupied=float((occupied & (gap_m > 2.0 * found.cell_m)).sum() / occupied.sum()),
    )


def states(found: OccupancyMap) -> tuple[Mask, Mask]:
    """What is free and what is occupied in the layers within the vehicle's reach of the height of the flight."""
    layers = dict(zip(found.levels, found.layers(), strict=True))
    near = [level for level in layers if abs((level + 0.5) * found.layer_m - HEIGHT_M) < found.layer_m]
    cells = np.stack([np.frombuffer(layers[level], np.uint8).reshape(found.rows, found.columns) for level in near])
    occupied: Mask = (cells == CELL_OCCUPIED).any(axis=0)
    return (cells == CELL_FREE).any(axis=0) & ~occupied, occupied


def picture(found: OccupancyMap, trail_m: Sequence[tuple[float, float]], title: str) -> str:
    """The map as an SVG, north up: free cells white, occupied ones dark, unknown grey, and the way flown."""
    free, occupied = states(found)
    scale = 4
    width, height = found.columns * scale, found.rows * scale
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img">',
        f"<title>{title}</title>",
        f'<rect width="{width}" height="{height}" fill="#c9cdd2"/>',
    ]
    for mask, colour in ((free, "#ffffff"), (occupied, "#20262d")):
        runs = [
            f"M{first * scale} {(found.rows - 1 - row) * scale}h{(end - first) * scale}v{scale}h-{(end - first) * scale}z"
            for row in range(found.rows)
            for first, end in _runs(mask[row])
        ]
        parts.append(f'<path d="{"".join(runs)}" fill="{colour}"/>')
    points = [
        (scale * (-y - found.corner_ne_m[1]) / found.cell_m, height - scale * (x - found.corner_ne_m[0]) / found.cell_m)
        for x, y in trail_m
    ]
    line = " ".join(f"{x:.0f},{y:.0f}" for x, y in points)
    parts.append(f'<polyline points="{line}" fill="none" stroke="#d9480f" stroke-width="4" stroke-linejoin="round"/>')
    if points:
        parts.append(f'<circle cx="{points[0][0]:.0f}" cy="{points[0][1]:.0f}" r="8" fill="#2b8a3e"/>')
    return "\n".join([*parts, "</svg>"]) + "\n"


def _runs(row: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], row.view(np.int8), [0]))))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]


def trail(ruler: courses.Ruler, apart_m: float = 0.25) -> list[tuple[float, float]]:
    """The way flown, thinned."""
    found: list[tuple[float, float]] = []
    for _, (x, y, _) in ruler.places_m:
        if not found or math.dist(found[-1], (x, y)) >= apart_m:
            found.append((x, y))
    return found
