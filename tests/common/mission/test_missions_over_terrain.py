"""Missions over terrain tiles: heights above the ground, paths that follow it, and paths that come too near to it."""

from pathlib import Path

import numpy as np
import pytest
from tests.terrain_tiles import level, ridge, write_tile

from gloc3.errors import InputError
from gloc3.messages.frames import GeoPoint, TangentPlane
from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.formats import exported
from gloc3.mission.model.arguments import FollowWaypointsOrder
from gloc3.mission.model.model import Mission
from gloc3.mission.reading.reader import MissionReferences, read_mission
from gloc3.mission.showing.cli import app
from gloc3.platform.reader import load_platform
from gloc3.terrain import FOLLOW_TOLERANCE_M, Terrain

TEXT = """\
mission: over a ridge
frame: geo
height_above: ABOVE
tasks:
  fly:
    actions:
      up: {take_off: {height_m: 40}}
      way:
        after: [up]
        follow_waypoints:
          waypoints:
            - [47.5, 8.49, 30]
            - [47.5, 8.51, HEIGHT]
          speed_m_s: 2
          MORE
      down: {land: {}, after: [way]}
"""
FOOT_M, TOP_M = 400.0, 480.0
HOME = GeoPoint(47.5, 8.489, 390.0)  # ten metres below the tile's ground there


def text(above: str = "ground", height: float = 30.0, more: str = "acceptance_m: 1") -> str:
    return TEXT.replace("ABOVE", above).replace("HEIGHT", f"{height:g}").replace("MORE", more)


@pytest.fixture
def terrain(tmp_path: Path) -> Terrain:
    """Level ground, and a ridge of 80 m halfway between the two waypoints."""
    write_tile(tmp_path, "N47E008", ridge(FOOT_M, TOP_M, 8.5, 0.004))
    return Terrain(tmp_path)


def checked(
    written: str, terrain: Terrain | None, home: GeoPoint | None = HOME, least_m: float | None = None
) -> CheckReport:
    return check_text(
        written,
        "ridge.yaml",
        Circumstances(
            origin=home,
            home_altitude_m=None if home is None else home.altitude_m,
            home_ned_m=None if home is None else (0.0, 0.0, 0.0),
            terrain=terrain,
            clearance_m=least_m,
        ),
    )


def order_of(mission: Mission) -> FollowWaypointsOrder:
    order = mission.actions()["fly.way"].order
    assert isinstance(order, FollowWaypointsOrder)
    return order


def messages(report: CheckReport) -> list[str]:
    return [str(finding) for finding in report.findings]


def test_without_tiles_heights_above_the_ground_are_refused() -> None:
    assert messages(checked(text(), None)) == [
        "ridge.yaml:3:15: heights above the ground need terrain tiles: none are given (name their folder: --terrain DIR)"
    ]
    with pytest.raises(InputError, match="need terrain tiles"):
        read_mission(text(), "ridge.yaml")


def test_a_missing_tile_refuses_the_mission_with_its_name(tmp_path: Path) -> None:
    write_tile(tmp_path, "N10E008", level(0.0))
    (finding,) = [one for one in checked(text(), Terrain(tmp_path)).findings if not one.is_warning]
    assert "the terrain tile N47E008 is not in" in finding.message
    assert finding.hint == "add the tile, or count heights from home"


def test_a_tile_that_is_missing_at_a_waypoint_alone_refuses_its_action(terrain: Terrain) -> None:
    far = text().replace("[47.5, 8.51, 30]", "[48.01, 8.51, 30]")
    finding, *_ = [one for one in checked(far, terrain).findings if not one.is_warning]
    assert "the terrain tile N48E008 is not in" in finding.message
    assert finding.line == 11


def test_the_path_follows_the_ground_within_the_tolerance(terrain: Terrain) -> None:
    report = checked(text(height=50.0), terrain)
    assert report.is_ok
    order = order_of(report.flyable())
    points = order.waypoints_ned_m
    assert 3 <= len(points) <= 8  # the two ends, and the corners of the ridge
    assert order.between == tuple(range(1, len(points) - 1))
    plane = TangentPlane(HOME)
    for share in np.linspace(0.0, 1.0, 400).tolist():
        longitude = 8.49 + 0.02 * share
        north, east, _ = plane.ned_from_geo(47.5, longitude, HOME.altitude_m)
        at = np.interp(east, [point[1] for point in points], [point[2] for point in points])
        height_m = plane.geo_from_ned((north, east, float(at))).altitude_m
        ground_m = terrain.altitude_m(47.5, longitude) - 10.0  # at home it is as high as home
        assert height_m - ground_m == pytest.approx(30.0 + 20.0 * share, abs=FOLLOW_TOLERANCE_M + 0.2)


def test_heights_count_from_the_ground_and_home_stands_on_it(terrain: Terrain) -> None:
    order = order_of(checked(text(), terrain).flyable())
    plane = TangentPlane(HOME)
    first, last = plane.geo_from_ned(order.waypoints_ned_m[0]), plane.geo_from_ned(order.waypoints_ned_m[-1])
    assert first == pytest.approx((47.5, 8.49, HOME.altitude_m + 30.0), abs=1e-6)
    assert last == pytest.approx((47.5, 8.51, HOME.altitude_m + 30.0), abs=1e-6)


def test_where_home_is_unknown_it_is_the_first_place(terrain: Terrain) -> None:
    order = order_of(checked(text(), terrain, home=None).flyable())
    assert order.waypoints_ned_m[0] == pytest.approx((0.0, 0.0, -30.0), abs=1e-6)


def test_a_path_through_the_ridge_is_reported_with_its_waypoint(terrain: Terrain) -> None:
    straight = text("home")
    (finding,) = [one for one in checked(straight, terrain, least_m=10.0).findings if not one.is_warning]
    assert finding.message.startswith("the path to waypoint 2 is 50.0 m below the ground at 47.5000")
    assert finding.message.endswith("; the limit is 10 m")
    assert finding.hint.startswith("raise it by 60.")
    assert (finding.line, finding.column) == (13, 15)
    report = checked(straight, terrain)
    assert report.is_ok
    assert any("is 50.0 m below the ground" in one for one in messages(report))


def test_heights_above_the_sea_are_compared_as_they_are(terrain: Terrain) -> None:
    sea = text("sea", height=470.0).replace("8.49, 30", "8.49, 470")
    (finding,) = [one for one in checked(sea, terrain, least_m=0.0).findings if not one.is_warning]
    assert "the path to waypoint 2 is 10" in finding.message


def test_a_path_that_keeps_its_clearance_is_not_reported(terrain: Terrain) -> None:
    assert [one for one in messages(checked(text(), terrain, least_m=25.0)) if "the ground" in one] == []
    assert [one for one in messages(checked(text(), terrain, least_m=29.9)) if "the limit is 29.9 m" in one]


def test_a_gap_in_the_tiles_is_a_remark_with_the_tile(terrain: Terrain) -> None:
    beyond = text("home").replace("[47.5, 8.51, 30]", "[47.5, 9.01, 30]")
    found = [one for one in messages(checked(beyond, terrain)) if "not checked there" in one]
    assert len(found) == 1
    assert "the terrain tile N47E009 is not in" in found[0]
    assert "warning" in found[0]


def test_a_stop_at_every_waypoint_is_refused_where_places_follow_the_ground(terrain: Terrain) -> None:
    finding, *_ = [one for one in checked(text(more="hold_s: 5"), terrain).findings if not one.is_warning]
    assert "hold_s would stop at the places that follow the ground, too" in finding.message


def test_a_survey_follows_the_ground(terrain: Terrain) -> None:
    written = """\
mission: survey
frame: geo
height_above: ground
geofence: {polygon: [[47.4, 8.4], [47.4, 8.6], [47.6, 8.6], [47.6, 8.4]], ceiling_m: 200}
tasks:
  fly:
    actions:
      up: {take_off: {height_m: 40}}
      way: {survey: {area: [[47.499, 8.49], [47.499, 8.51], [47.501, 8.51], [47.501, 8.49]], height_m: 40, spacing_m: 60}, after: [up]}
      down: {land: {}, after: [way]}
"""
    report = checked(written, terrain, least_m=35.0)
    assert report.is_ok, messages(report)
    assert any("the ceiling is level: it counts from home" in one for one in messages(report))
    order = order_of(report.flyable())
    heights = [-down for _, _, down in order.waypoints_ned_m]
    assert max(heights) == pytest.approx(120.0, abs=FOLLOW_TOLERANCE_M + 1.0)
    assert min(heights) == pytest.approx(40.0, abs=1.0)


def test_a_ceiling_below_the_ridge_refuses_the_path_over_it(terrain: Terrain) -> None:
    fenced = text().replace("tasks:", "geofence: {ceiling_m: 100}\ntasks:")
    found = [one for one in messages(checked(fenced, terrain)) if "outside the fence" in one]
    assert found
    assert all("waypoint 2" in one for one in found)


def test_an_altitude_of_home_that_the_tiles_contradict_is_told(terrain: Terrain) -> None:
    found = messages(checked(text(), terrain, home=HOME._replace(altitude_m=300.0)))
    assert any("home is 300 m above the sea by the autopilot, 400 m by the terrain tile" in one for one in found)


def test_an_exported_plan_keeps_heights_above_the_ground_as_they_are() -> None:
    mission = read_mission(text(), "ridge.yaml", MissionReferences(is_ground_level=True))
    plan, _ = exported(mission, ".waypoints", "ridge.yaml")
    rows = [line.split("\t") for line in plan.splitlines()[1:]]
    assert [(row[2], float(row[10])) for row in rows if row[3] == "16" and float(row[10])] == [
        ("10", 30.0),
        ("10", 30.0),
    ]


def test_waypoints_too_far_apart_are_refused(terrain: Terrain) -> None:
    far = text().replace("[47.5, 8.51, 30]", "[49.5, 8.51, 30]")
    assert any("km apart; above the ground at most 100 km" in one for one in messages(checked(far, terrain)))


def test_a_plane_is_not_told_that_places_between_are_too_near(terrain: Terrain) -> None:
    plane = load_platform("plane")
    written = (
        text(height=60.0)
        .replace("8.49, 30", "8.49, 60")
        .replace("height_m: 20", "height_m: 40")
        .replace("speed_m_s: 2", "speed_m_s: 20")
    )
    report = check_text(
        written,
        "f",
        Circumstances(platform=plane, origin=HOME, home_altitude_m=390.0, home_ned_m=(0.0, 0.0, 0.0), terrain=terrain),
    )
    assert [one for one in messages(report) if "m long; to turn" in one] == []


def test_a_vehicle_on_the_ground_is_not_checked_against_it(terrain: Terrain) -> None:
    drive = """\
mission: drive
frame: geo
tasks:
  go: {actions: {off: {depart: {}}, way: {transit: {to: [[47.5, 8.51]]}, after: [off]}}}
"""
    report = check_text(drive, "f", Circumstances(platform=load_platform("rover"), terrain=terrain))
    assert [one for one in messages(report) if "the ground" in one and "below" in one] == []


def test_the_command_checks_and_draws_the_profile(
    terrain: Terrain, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "ridge.yaml"
    file.write_text(text("home"))
    assert app(["check", str(file)], result_action="return_value") == 0
    assert "ground" not in capsys.readouterr().out
    assert app(["check", str(file), "--terrain", str(tmp_path), "--clearance", "20"], result_action="return_value") == 1
    assert "the path to waypoint 2 is 50.0 m below the ground" in capsys.readouterr().out
    file.write_text(text())
    assert app(["show", str(file), "--terrain", str(tmp_path)], result_action="return_value") == 0
    shown = capsys.readouterr().out.splitlines()
    start = next(number for number, line in enumerate(shown) if line.startswith("ground: "))
    assert shown[start].startswith("ground: the path is lowest 29.")
    drawn = shown[start + 1 : start + 10]
    assert "•" in drawn[0]
    assert "█" in "".join(drawn)
    assert max(map(len, shown)) <= 80
    assert shown[start + 10].split()[0] == "0"
    assert shown[start + 10].split()[1:] == ["1527", "m"]
