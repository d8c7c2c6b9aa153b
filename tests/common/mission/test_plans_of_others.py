"""Plans of other programs: home, heights, departures, losses and refusals, with the lines of the user's file."""

import json
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavwp

from gloc3.errors import InputError
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.formats import (
    in_source,
    load_plan,
    read_plan,
    read_wpl,
    to_mission,
    write_plan,
    write_wpl,
)
from gloc3.mission.formats.from_mission import from_mission
from gloc3.mission.formats.items import FenceArea
from gloc3.mission.formats.plan_format import lost_in_waypoints
from gloc3.mission.reading.reader import read_mission
from gloc3.platform.reader import load_platform

HEADER = "QGC WPL 110\n"
HOME = "0 1 0 16 0 0 0 0 47.0 8.0 488 1\n"
CLIMB = "1 0 3 22 0 0 0 0 47.0 8.0 10 1\n"


def converted(text: str, platform: str | None = None) -> tuple[str, list[str]]:
    """The mission that a file of waypoints becomes, and the warnings."""
    on = load_platform(platform) if platform is not None else None
    mission, warnings = to_mission(read_wpl(text, "f"), "m", "f", on)
    return mission, [str(warning) for warning in warnings]


def refused(text: str, platform: str | None = None) -> list[str]:
    with pytest.raises(InputError) as caught:
        converted(text, platform)
    return [str(finding) for finding in caught.value.findings if not finding.is_warning]


def test_the_first_item_is_home_whatever_frame_the_others_are_in() -> None:
    text = HEADER + HOME + "1 0 0 22 0 0 0 0 47.0 8.0 498 1\n2 0 0 16 0 0 0 0 47.001 8.0 508 1\n"
    plan = read_wpl(text, "f")
    assert plan.home == (47.0, 8.0, 488.0)
    assert [item.command for item in plan.items] == [22, 16]
    assert json.loads(write_plan(plan))["mission"]["plannedHomePosition"] == [47.0, 8.0, 488.0]
    mission, warnings = converted(text)
    assert warnings == []
    assert "height_above: sea" in mission
    assert "height_m: 10.0" in mission
    assert "- [47.001, 8.0, 508.0]" in mission
    assert "488" not in mission


def test_a_written_waypoint_file_begins_with_home_and_is_read_by_pymavlink(tmp_path: Path) -> None:
    mission = read_mission(
        "{mission: m, frame: geo, tasks: {t: {actions: {a: {take_off: {height_m: 5}}, "
        "b: {go_to: {position: [47, 8, 5], heading: along}, after: [a]}}}}}",
        "m",
    )
    plan, _ = from_mission(mission, "m")
    file = tmp_path / "m.waypoints"
    file.write_text(write_wpl(plan))
    assert "nan" not in file.read_text()
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(file)) == len(plan.items) + 1
    first = loader.wp(0)
    assert (first.command, first.frame, first.x, first.y) == (16, 0, 47.0, 8.0)
    assert [loader.wp(number).command for number in range(1, loader.count())] == [item.command for item in plan.items]
    lost = [str(warning) for warning in lost_in_waypoints(plan, "m")]
    assert lost == ["m: warning: a waypoint file cannot leave a heading open: 0 is written (PX4 turns to north there)"]


def test_comments_gaps_and_blank_lines_are_read_and_gaps_are_told() -> None:
    text = HEADER + "# home\n" + HOME + "\n  # climb\n" + CLIMB + "4 0 3 16 0 0 0 0 47.001 8.0 10 1\n"
    plan = read_wpl(text, "f")
    assert plan.lines == (6, 7)
    assert [str(finding) for finding in plan.findings] == [
        (
            "f:7:1: warning: item 4 stands where item 2 is expected: items count by their order "
            "(number the items from 0 without gaps)"
        )
    ]
    jumps = text + "5 0 3 177 4 2 0 0 0 0 0 1\n"
    assert "check where the jumps lead" in str(read_wpl(jumps, "f").findings[0])


def test_old_files_of_qgroundcontrol_have_no_home() -> None:
    plan = read_wpl("QGC WPL 120\n0 1 3 22 0 0 0 0 47.0 8.0 10 1\n", "f")
    assert (plan.home, [item.command for item in plan.items]) == (None, [22])


@pytest.mark.parametrize(
    ("platform", "first"),
    [("rover", "depart: {}"), ("boat", "depart: {}"), ("submarine", "depth_m: 3.0"), ("copter", "depart: {}")],
)
def test_a_plan_without_a_take_off_departs_in_the_vehicles_own_way(platform: str, first: str) -> None:
    height_m = {"rover": 0, "boat": 0, "submarine": -3, "copter": 10}[platform]
    rows = "".join(f"{n} 0 3 16 0 0 0 0 47.000{n} 8.0 {height_m} 1\n" for n in (1, 2))
    mission, warnings = converted(HEADER + HOME + rows, platform)
    assert first in mission
    wanted = "the plan has no take-off: the mission begins with depart"
    assert any(wanted in warning for warning in warnings) == (platform == "copter")
    report = check_text(mission, "m", Circumstances(platform=load_platform(platform)))
    assert report.is_ok, [str(finding) for finding in report.findings]
    assert not [one for one in report.findings if "started in the air" in one.message]


def test_a_take_off_and_heights_of_a_plan_are_left_out_for_a_rover() -> None:
    mission, warnings = converted(HEADER + HOME + CLIMB + "2 0 3 16 0 0 0 0 47.0003 8.0 10 1\n", "rover")
    assert "take_off" not in mission
    assert "- [47.0003, 8.0, 0.0]" in mission
    assert any("f:3:1: warning: item 1, NAV_TAKEOFF, is left out" in warning for warning in warnings)
    assert any("the heights of 1 items are left out" in warning for warning in warnings)


def test_mixed_heights_are_counted_from_one_reference() -> None:
    rows = "2 0 3 16 0 0 0 0 47.001 8.0 20 1\n3 0 0 16 0 0 0 0 47.002 8.0 518 1\n"
    mission, _ = converted(HEADER + HOME + CLIMB + rows)
    assert "- [47.001, 8.0, 20.0]" in mission
    assert "- [47.002, 8.0, 30.0]" in mission
    without = HEADER + HOME.replace("47.0 8.0 488", "0 0 0") + CLIMB + rows
    assert "f:5:1: item 3, NAV_WAYPOINT: its height counts from sea, those of others from home" in refused(without)[0]


def test_a_waypoint_without_a_position_climbs_where_the_one_before_it_is() -> None:
    rows = "2 0 3 16 0 0 0 0 47.001 8.0 20 1\n3 0 3 16 0 0 0 0 0 0 40 1\n"
    mission, _ = converted(HEADER + HOME + CLIMB + rows)
    assert "- [47.001, 8.0, 40.0]" in mission
    nowhere = HEADER + HOME.replace("47.0 8.0 488", "0 0 0") + "1 0 3 16 0 0 0 0 0 0 40 1\n"
    assert refused(nowhere) == [
        (
            "f:3:1: item 1, NAV_WAYPOINT: it has no position, and there is none before it "
            "(give it a position, or the plan a home)"
        )
    ]


def test_everything_that_is_dropped_is_a_warning_with_its_line() -> None:
    rows = (
        "2 0 3 16 0 7 9 0 47.001 8.0 20 0\n"
        "3 0 3 19 5 0 30 1 47.002 8.0 20 1\n"
        "4 0 2 178 1 4 60 0 0 0 0 1\n"
        "5 0 3 21 15 2 0 90 47.0 8.0 3 1\n"
    )
    _, warnings = converted(HEADER + HOME + CLIMB.replace("22 0", "22 15") + rows)
    assert warnings == [
        "f:3:1: warning: item 1, NAV_TAKEOFF: the pitch of 15 degrees is left out",
        "f:4:1: warning: item 2, NAV_WAYPOINT: the acceptance radius of 7 m is left out (set acceptance_m by hand)",
        "f:4:1: warning: item 2, NAV_WAYPOINT: the radius of 9 m to pass by at is left out",
        "f:4:1: warning: item 2, NAV_WAYPOINT: autocontinue is off, but the mission goes on (add a hold by hand)",
        "f:5:1: warning: item 3, NAV_LOITER_TIME: the loiter radius of 30 m is left out",
        "f:5:1: warning: item 3, NAV_LOITER_TIME: where it leaves the circle is left out",
        "f:6:1: warning: item 4, DO_CHANGE_SPEED: the throttle of 60 % is left out",
        "f:7:1: warning: item 5, NAV_LAND: the height of 15 m to abort at is left out",
        "f:7:1: warning: item 5, NAV_LAND: the precision landing mode 2 is left out",
        "f:7:1: warning: item 5, NAV_LAND: the heading of 90 degrees is left out",
        "f:7:1: warning: item 5, NAV_LAND: the height of 3 m is left out: it lands on the ground",
    ]


def test_a_refusal_names_the_command_and_the_line_in_the_users_file() -> None:
    found = refused(HEADER + HOME + CLIMB + "# again\n2 0 2 177 1 3 0 0 0 0 0 1\n")
    assert found[0].startswith(
        "f:5:1: item 2, DO_JUMP: cannot be expressed in a mission (take it out, or have the autopilot fly"
    )
    plan = json.dumps(PLAN, indent=1)
    line = next(n for n, text in enumerate(plan.splitlines(), 1) if '"command": 82' in text)
    with pytest.raises(InputError) as caught:
        to_mission(read_plan(plan, "p"), "p", "p")
    finding = caught.value.findings[0]
    assert "item 2, NAV_SPLINE_WAYPOINT" in finding.message
    assert abs(finding.line - line) <= 3


PLAN: dict[str, Any] = {
    "fileType": "Plan",
    "version": 1,
    "groundStation": "test",
    "geoFence": {"version": 2, "circles": [], "polygons": []},
    "rallyPoints": {"version": 2, "points": []},
    "mission": {
        "version": 2,
        "firmwareType": 12,
        "vehicleType": 2,
        "hoverSpeed": 2,
        "cruiseSpeed": 15,
        "plannedHomePosition": [47.0, 8.0, 400.0],
        "items": [
            {"type": "SimpleItem", "command": 22, "frame": 3, "params": [0, 0, 0, None, 47, 8, 10], "doJumpId": 1},
            {"type": "SimpleItem", "command": 82, "frame": 3, "params": [0, 0, 0, None, 47.001, 8, 10], "doJumpId": 2},
        ],
    },
}


def test_a_finding_about_the_converted_mission_names_the_line_of_the_plan() -> None:
    rows = "2 0 3 16 0 0 0 0 47.0002 8.0 20 1\n3 0 3 16 0 0 0 0 47.0004 8.0 55 1\n"
    text = HEADER + HOME + CLIMB + rows
    on = load_platform("pelican_rtk")
    mission, _ = to_mission(read_wpl(text, "f"), "m", "f", on)
    report = check_text(mission, "m (converted)", Circumstances(platform=on))
    found = [str(one) for one in in_source(report.findings, mission, "m (converted)", "f") if not one.is_warning]
    assert found == [
        (
            "f:5:1: waypoint 2 is 55.0 m above home; the platform's limit is 30 m "
            "(lower it by 25.0 m, or raise limits.height_max_m in the platform file)"
        )
    ]


@pytest.mark.parametrize(
    ("part", "value", "message"),
    [
        ("polygons", [{"polygon": 5}], "a list of corners is expected here"),
        ("polygons", 5, "a list is expected here"),
        ("polygons", [5], "an entry of polygons is not a mapping"),
        ("circles", [None], "an entry of circles is not a mapping"),
        ("circles", {"circle": {}}, "a list is expected here"),
    ],
)
def test_a_fence_of_another_form_is_a_finding(part: str, value: Any, message: str) -> None:
    plan = {**PLAN, "geoFence": {"version": 2, "circles": [], "polygons": [], part: value}}
    with pytest.raises(InputError) as caught:
        read_plan(json.dumps(plan, indent=1), "p")
    assert message in str(caught.value.findings[0])
    assert caught.value.findings[0].line > 1


def test_lists_of_fence_and_rally_points_are_read(tmp_path: Path) -> None:
    fence = tmp_path / "fence.txt"
    fence.write_text("# home field\n47.0 8.0\n47.1 8.0\n47.1 8.1\n47.0 8.1\n47.1 8.0\n")
    plan = load_plan(fence)
    corners = ((47.1, 8.0), (47.1, 8.1), (47.0, 8.1))
    assert (plan.fence_return, plan.fence) == ((47.0, 8.0), (FenceArea(is_inclusion=True, polygon=corners),))
    assert [item.command for item in plan.fence_items()] == [5000, 5001, 5001, 5001]
    assert load_plan(_written(tmp_path / "again.txt", write_wpl(plan))).content == plan.content
    rally = tmp_path / "rally.txt"
    rally.write_text("RALLY\t47.0\t8.0\t40.0\t30.0\t0.0\t0\n")
    found = load_plan(rally)
    assert found.rally == ((47.0, 8.0, 40.0),)
    assert "1:1: warning: the rally point's break altitude" in str(found.findings[0])


def _written(file: Path, text: str) -> Path:
    file.write_text(text)
    return file


@pytest.mark.parametrize(
    ("text", "finding"),
    [
        ("47 8\n47.1 8\n", "f:2:1: a fence needs its return point and three corners (add corners)"),
        ("47 8\n47.1 8\n147.1 8\n", "f:3:1: a latitude and a longitude are expected here (one point a line)"),
        ("47 8\n47.1 x\n", "f:2:1: a latitude and a longitude are expected here (one point a line)"),
        ("RALLY 47 8\n", "f:1:1: RALLY, a latitude, a longitude and a height are expected here (one point a line)"),
        ("RALLY 147 8 1\n", "f:1:1: 147, 8 is not a latitude and longitude"),
        (HEADER + "0 0 0 5001 4 0 0 0 47 8 0 1\n", "f:2:1: fence item 0 (NAV_FENCE_POLYGON_VERTEX_INCLUSION) is not"),
    ],
)
def test_lists_that_cannot_be_read_are_refused_by_line(text: str, finding: str) -> None:
    with pytest.raises(InputError) as caught:
        read_wpl(text, "f")
    assert str(caught.value.findings[0]).startswith(finding)


def test_a_waypoint_file_of_fence_and_rally_items_is_no_mission_but_has_a_use() -> None:
    corners = "".join(f"{n} 0 0 5001 3 0 0 0 47.{n} 8.{n * n} 0 0\n" for n in range(3))
    plan = read_wpl(HEADER + corners + "3 0 3 5100 0 0 0 0 47.1 8.1 30 1\n", "f")
    assert (plan.items, len(plan.fence), plan.rally) == ((), 1, ((47.1, 8.1, 30.0),))
    with pytest.raises(InputError, match=r"no item that moves the vehicle \(its fence and rally points go to the auto"):
        to_mission(plan, "f", "f")
