"""The map that is built in flight: against the world's truth, and what is not entered."""

import math
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from tests.onboard.algorithms.scan_matching.rays import Scanner, Wall, box
from tests.onboard.messages import pose
from tests.onboard.stage import Stage
from tests.sitl.world.conftest import STANDING_HEIGHT_M, truth_of

from gloc3.errors import Refused
from gloc3.messages.frames import from_euler
from gloc3.messages.neighbours import Neighbour, Neighbours
from gloc3.messages.perception import CELL_FREE, CELL_OCCUPIED, CELL_UNKNOWN, OccupancyMap
from gloc3.messages.vehicle import HeightAboveGround
from gloc3.platform.reader import load_platform
from gloc3.terrain.map_file import write_map
from gloc3_onboard.algorithms.mapping.known_space import cells_of
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.cli.platform_report import report_on
from gloc3_onboard.components.processors.map import MapProcessor, MapSettings
from gloc3_onboard.inputs import known_map
from gloc3_sitl.world import World
from gloc3_sitl.world.laser import LaserModel, LaserScanner

ROOM = box(-4.0, -4.0, 8.0, 8.0)


class Mapping:
    """The processor on its stage, with a scanner in the middle of the body among upright walls."""

    def __init__(self, walls: list[Wall], known: OccupancyMap | None = None, **settings: Any) -> None:
        self.stage = Stage(MapProcessor(known), MapSettings(**settings))
        self.random = np.random.default_rng(3)
        self.walls = walls
        self.at = Planar()

    def scan(self, times: int = 1, **others: Any) -> None:
        for _ in range(times):
            found = Scanner(self.walls, range_max_m=12.0).scan(self.at, self.random)
            place = pose(self.at.x_m, self.at.y_m, 2.2, ned_from_frd=from_euler(0.0, 0.0, self.at.yaw_rad))
            self.stage.step(0.2, **{"pose": place, "laser": found, **others})

    @property
    def last(self) -> OccupancyMap:
        self.stage.step(1.1)
        found = self.stage.last(OccupancyMap)
        assert isinstance(found, OccupancyMap)
        return found

    def state(self, north: float, east: float) -> int:
        found = self.last
        row, column = (
            math.floor((at - first) / found.cell_m) for at, first in zip((north, east), found.corner_ne_m, strict=True)
        )
        return found.layer_of_vehicle()[row * found.columns + column]


def test_the_map_is_the_worlds_truth_at_every_height_that_was_flown() -> None:
    """From four places in the hold, level and tilted: what is called free is free, what is occupied is where things are."""
    world, mount = World.load("hold"), (0.0, 0.0, -0.08)
    scanner = LaserScanner(world, LaserModel(position_frd_m=mount), seed=4)
    stage = Stage(MapProcessor(), MapSettings(mount_frd_m=mount, range_m=20.0))
    for number in range(48):
        x, y = ((2.0, 2.0), (16.0, 2.0), (16.0, 8.0), (2.0, 8.0))[number % 4]
        height_m, tilt = (1.0, 3.0)[number // 24], (0.05 * math.sin(number), 0.05 * math.cos(number), 0.3 * number)
        place = pose(x, -y, height_m, ned_from_frd=from_euler(*tilt))
        scan = scanner.scan(truth_of(world, (x, y, height_m), tilt, t_s=float(number)))
        above = HeightAboveGround(height_m=height_m + STANDING_HEIGHT_M, is_valid=True)
        stage.step(0.5, pose=place, laser=scan, height=above)
    found = stage.last(OccupancyMap)
    assert set(found.levels) >= {2, 6}
    for level in (2, 6):
        cells = cells_of(found)[found.levels.index(level)]
        middle_m = (level + 0.5) * found.layer_m + STANDING_HEIGHT_M
        for state, least_m, most_m in ((CELL_OCCUPIED, 0.0, 0.25), (CELL_FREE, 0.02, math.inf)):
            rows, columns = np.nonzero(cells == state)
            chosen = np.random.default_rng(level).permutation(len(rows))[:150]
            north = found.corner_ne_m[0] + (rows[chosen] + 0.5) * found.cell_m
            east = found.corner_ne_m[1] + (columns[chosen] + 0.5) * found.cell_m
            gaps_m = [world.geometry.clearance_m((n, -e, middle_m), 0.0) for n, e in zip(north, east, strict=True)]
            assert sum(least_m <= gap_m <= most_m for gap_m in gaps_m) >= 0.98 * len(gaps_m), (level, state)
    flown = cells_of(found)[found.levels.index(2)]
    assert np.count_nonzero(flown == CELL_FREE) * found.cell_m**2 > 250.0


def test_a_box_that_appears_is_entered_within_two_seconds_and_one_that_goes_away_is_free_again() -> None:
    mapping = Mapping(ROOM)
    mapping.scan(10)
    assert mapping.state(2.0, 0.0) == CELL_FREE
    mapping.walls = [*ROOM, *box(2.0, -0.5, 1.0, 1.0)]
    mapping.scan(8)
    assert mapping.state(2.0, 0.0) == CELL_OCCUPIED
    mapping.walls = ROOM
    mapping.scan(40)
    assert (mapping.state(2.0, 0.0), mapping.state(2.5, 0.0)) == (CELL_FREE, CELL_FREE)


def test_a_map_that_is_known_is_there_at_the_start_and_what_is_seen_counts_more(tmp_path: Path) -> None:
    """Saved after one flight in a room with a box, known in the next one, in which the box has gone."""
    first = Mapping([*ROOM, *box(2.0, -0.5, 1.0, 1.0)])
    first.scan(10)
    saved = first.last
    write_map(tmp_path / "room.yaml", saved)
    platform = tmp_path / "mine.yaml"
    platform.write_text("extends: pelican\nplatform: pelican\nknown_map: room.yaml\n")
    known = known_map(load_platform(str(platform)), tmp_path)
    second = Mapping(ROOM, known)
    second.at = Planar(-3.0, -3.0, 0.0)
    second.scan(1)
    assert second.state(2.0, 0.0) == CELL_OCCUPIED
    assert second.last.levels == saved.levels
    second.scan(40)
    assert (second.state(2.0, 0.0), second.state(2.5, 0.0)) == (CELL_FREE, CELL_FREE)
    with pytest.raises(Refused, match=r"cells of 0\.1 m and layers of 0\.5 m; set cell_m and layer_m, which are 0\.2"):
        Mapping(ROOM, known, cell_m=0.2)


@pytest.mark.parametrize(
    ("changes", "settings", "why"),
    [
        (
            {"cell_m": 0.05},
            "",
            r"cells of 0\.05 m and layers of 0\.5 m \(set cell_m and layer_m, which are 0\.1 and 0\.5\)",
        ),
        (
            {"layer_m": 1.0},
            "",
            r"cells of 0\.1 m and layers of 1 m \(set cell_m and layer_m, which are 0\.1 and 0\.5\)",
        ),
        (
            {},
            "most_m: 10",
            r"is 9\.6 m by 12 m with 2 layers \(set most_m and most_layers, which are 10 and 16, or cut it\)",
        ),
        ({}, "most_layers: 1", "set most_m and most_layers, which are 80 and 1, or cut it"),
        ({}, "", ""),
    ],
)
def test_a_known_map_that_does_not_fit_the_settings_is_found_before_the_flight(
    changes: dict[str, float], settings: str, why: str, tmp_path: Path
) -> None:
    cells = np.full((2, 96, 120), CELL_FREE, np.uint8)
    known = OccupancyMap(
        corner_ne_m=(-3.2, -6.0),
        cell_m=0.1,
        rows=96,
        columns=120,
        layer_m=0.5,
        levels=[1, 2],
        cells=zlib.compress(cells.tobytes()),
    )
    write_map(tmp_path / "room.yaml", replace(known, **changes))
    platform = tmp_path / "mine.yaml"
    row = f"components: [{{name: map, settings: {{{settings}}}}}]\n"
    platform.write_text(f"extends: pelican\nplatform: mine\nknown_map: room.yaml\n{row}")
    report = report_on(str(platform))
    assert report.is_ok == (not why)
    assert not why or re.search(why, str(report.findings[0]))


def test_a_vehicle_outside_a_map_of_the_largest_size_enters_nothing_and_says_so() -> None:
    away = OccupancyMap(
        corner_ne_m=(20.0, 20.0),
        cell_m=0.1,
        rows=10,
        columns=10,
        layer_m=0.5,
        levels=[4],
        cells=zlib.compress(bytes([CELL_FREE] * 100)),
    )
    mapping = Mapping(ROOM, away, most_m=20.0)
    mapping.scan(5)
    component = mapping.stage.component
    assert isinstance(component, MapProcessor)
    assert component.reason == "the vehicle is outside the map, which is as large as it may be: 20 m"
    assert (component.scans, component.left_out) == (0, 5)
    assert mapping.stage.valid_s[OccupancyMap] == 0.2


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"is_valid": False}, "there is no valid pose at the time of the scan"),
        ({"position_std_m": (0.1, 0.4, 0.1)}, "the pose is not certain enough: 0.40 m"),
    ],
)
def test_cells_that_are_seen_with_a_bad_pose_are_not_entered(wrong: dict[str, Any], why: str) -> None:
    mapping = Mapping(ROOM)
    mapping.scan(5, pose=replace(pose(height=2.2), **wrong))
    component = mapping.stage.component
    assert isinstance(component, MapProcessor)
    assert (component.scans, component.left_out, component.reason) == (0, 5, why)
    assert mapping.last.levels == []
    mapping.scan(5)
    assert (component.scans, component.reason) == (5, "")


def test_a_pose_that_is_late_and_a_damaged_scan_are_left_out() -> None:
    mapping = Mapping(ROOM)
    mapping.stage.put(0.0, pose=pose(height=2.2))
    mapping.stage.step(0.5, laser=Scanner(ROOM).scan(Planar(), mapping.random))
    damaged = replace(Scanner(ROOM).scan(Planar(), mapping.random), ranges_m=b"torn")
    mapping.stage.step(0.5, pose=pose(height=2.2), laser=damaged)
    assert getattr(mapping.stage.component, "left_out") == 2  # noqa: B009
    assert mapping.last.levels == []


def test_another_vehicle_is_not_entered() -> None:
    there = Neighbour(name="stork", position_ned_m=(2.5, 0.0, -2.2), velocity_ned_m_s=(0.0, 0.0, 0.0), t_s=0.0)
    for others, expected in (({}, CELL_OCCUPIED), ({"neighbours": Neighbours(vehicles=[there])}, CELL_UNKNOWN)):
        mapping = Mapping([*ROOM, *box(2.25, -0.25, 0.5, 0.5)])
        mapping.scan(10, **others)
        assert mapping.state(2.25, 0.0) == expected
        assert mapping.state(4.0, 3.0) == CELL_OCCUPIED


def test_it_is_reported_once_a_second_less_often_unchanged_and_stays_within_its_bounds() -> None:
    mapping = Mapping(box(-9.0, -9.0, 18.0, 18.0), most_m=10.0)
    mapping.scan(25)  # 5 s
    assert 4 <= len(mapping.stage.all(OccupancyMap)) <= 6
    found = mapping.last
    assert max(found.rows, found.columns) * found.cell_m <= 10.0
    assert len(found.cells) < 20_000
    before = len(mapping.stage.all(OccupancyMap))
    for _ in range(100):
        mapping.stage.step(0.1, pose=pose(height=2.2))
    assert len(mapping.stage.all(OccupancyMap)) - before <= 2


def test_its_time_is_that_of_the_last_scan_in_it_and_of_the_first_cycle_before_there_is_one() -> None:
    mapping = Mapping(ROOM)
    for seconds in (1.0, 6.0):
        mapping.stage.step(seconds, pose=pose(height=2.2))
        assert mapping.stage.valid_s[OccupancyMap] == 1.0
    mapping.scan(6)
    entered_s = mapping.stage.now_s
    assert entered_s - mapping.stage.valid_s[OccupancyMap] <= 1.0
    mapping.scan(30, pose=pose(height=2.2, is_valid=False))
    assert mapping.stage.valid_s[OccupancyMap] == entered_s


def test_a_map_that_scans_do_not_change_is_reported_every_second() -> None:
    mapping = Mapping(ROOM)
    found = Scanner(ROOM, range_max_m=12.0).scan(Planar(), mapping.random)
    for _ in range(100):
        mapping.stage.step(0.2, pose=pose(height=2.2), laser=found)
        assert mapping.stage.now_s - mapping.stage.valid_s.get(OccupancyMap, 0.0) < 1.5
