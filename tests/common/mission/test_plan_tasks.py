"""Tasks that another program's plan makes up: carried with the mission, read, checked, and given as an order."""

import json
from pathlib import Path

import msgspec
import pytest

from gloc3.errors import Finding, InputError
from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.formats import mission_text
from gloc3.mission.formats.as_it_is import FlyFileOrder
from gloc3.mission.reading.reader import MissionReferences, read_mission
from gloc3.mission.reading.writer import write_mission
from gloc3.mission.showing.cli import app
from gloc3.platform.reader import load_platform

PLAN = (
    "QGC WPL 110\n0 1 0 16 0 0 0 0 47.0 8.0 488 1\n1 0 3 22 0 0 0 0 0 0 10 1\n2 0 3 16 3 0 0 0 47.0002 8.0 10 1\n"
    "3 0 2 178 1 3 0 0 0 0 0 1\n4 0 3 82 0 0 0 0 47.0002 8.0002 25 1\n5 0 2 177 2 2 0 0 0 0 0 1\n6 0 2 20 0 0 0 0 0 0 0 1\n"
)
MISSION = "mission: m\nframe: geo\ntasks:\n  fly: {flown_by: autopilot, plan: field.waypoints}\n"


def carried(content: str = PLAN, mission: str = MISSION, name: str = "field.waypoints") -> str:
    return mission.replace("field.waypoints", json.dumps({name: content}))


def checked(text: str, platform: str | None = "pelican_rtk") -> CheckReport:
    return check_text(text, "m", Circumstances(platform=load_platform(platform) if platform is not None else None))


def told(findings: tuple[Finding, ...]) -> list[str]:
    return [str(one) for one in findings]


def order_of(text: str, platform: str = "pelican_rtk") -> FlyFileOrder:
    mission = read_mission(text, "m", MissionReferences.of(load_platform(platform)))
    order = mission.actions()["fly.plan"].order
    assert isinstance(order, FlyFileOrder)
    return order


def test_the_plan_travels_with_the_mission_and_is_read_from_its_text_again(tmp_path: Path) -> None:
    (tmp_path / "field.waypoints").write_text(PLAN)
    file = tmp_path / "m.yaml"
    file.write_text(MISSION)
    _, text, _ = mission_text(str(file))
    assert text == carried()
    report = checked(text)
    assert (report.is_ok, told(report.findings)) == (True, [])
    assert report.mission is not None
    assert order_of(write_mission(report.mission)) == order_of(text)
    file.write_text(MISSION.replace("field", "none"))
    with pytest.raises(InputError, match=r"4:36: none.waypoints cannot be read: no such file"):
        mission_text(str(file))
    file.write_text(MISSION.replace("field.waypoints", "/etc/passwd"))
    with pytest.raises(InputError, match="/etc/passwd is not a relative path"):
        mission_text(str(file))


def test_the_order_holds_the_items_unchanged_and_the_path_with_its_jumps() -> None:
    order = order_of(carried())
    assert [item.command for item in order.items] == [22, 16, 178, 82, 177, 20]
    assert order.home == (47.0, 8.0, 488.0)
    places = [place.name.partition(",")[0] for place in order.path]
    assert places == ["item 1", "item 2", "item 4", "item 2", "item 4", "item 2", "item 4", "item 6"]
    assert order.path[1].stay_s == 3.0
    assert [place.speed_m_s for place in order.path[1:4]] == [0.0, 3.0, 3.0]
    assert (order.sets_off, order.comes_down, order.never_ends, order.may_arm) == (True, True, "", True)
    assert order.last_item == 6
    assert order_of(carried(PLAN + "7 0 3 17 0 0 0 0 47.0 8.0 9 1\n")).last_item == 6
    assert msgspec.convert(msgspec.to_builtins(order), FlyFileOrder) == order


def test_what_is_too_high_names_the_item_and_its_line() -> None:
    found = told(checked(carried(PLAN.replace("8.0002 25", "8.0002 35"))).findings)
    assert found[0].startswith(
        "m:4:36: item 4, NAV_SPLINE_WAYPOINT, line 6 of field.waypoints is 35.0 m above home; the platform's limit is 30 m"
    )


def test_a_return_that_takes_too_much_names_the_item_where_it_would_begin() -> None:
    far = PLAN.replace("47.0002 8.0002 25", "47.02 8.0002 25")
    found = [one for one in told(checked(carried(far)).findings) if "the return from" in one]
    assert "the farthest place, item 4, NAV_SPLINE_WAYPOINT, line 6 of field.waypoints, takes" in found[0]


def test_a_plan_that_is_a_fence_alone_says_so() -> None:
    fence = "QGC WPL 110\n0 1 0 16 0 0 0 0 47.0 8.0 488 1\n" + "".join(
        f"{number} 0 0 5001 3 0 0 0 {place} 0 1\n"
        for number, place in enumerate(("47.0 8.0", "47.001 8.0", "47.001 8.001"), start=1)
    )
    found = told(checked(carried(fence)).findings)
    assert any("field.waypoints has no mission items, only a fence" in one for one in found)


def test_an_order_says_with_which_line_it_begins() -> None:
    assert order_of(carried()).begins_with.startswith("item 1, NAV_")
    assert ", line " in order_of(carried()).begins_with


def test_the_plans_fence_is_the_missions_and_a_place_outside_it_is_found() -> None:
    plan = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "test",
        "geoFence": {
            "version": 2,
            "circles": [{"inclusion": True, "version": 1, "circle": {"center": [47.0, 8.0], "radius": 30}}],
            "polygons": [],
        },
        "rallyPoints": {"version": 2, "points": [[47.0, 8.0, 5.0]]},
        "mission": {
            "version": 2,
            "plannedHomePosition": [47.0, 8.0, 400.0],
            "items": [
                {"type": "SimpleItem", "command": 22, "frame": 3, "params": [0, 0, 0, None, 47, 8, 10]},
                {"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, None, 47.0005, 8, 10]},
            ],
        },
    }
    report = checked(carried(json.dumps(plan), name="field.plan"))
    found = told(report.findings)
    assert any("item 2, NAV_WAYPOINT" in one and "outside the fence" in one for one in found)
    assert any("the plan's rally points are left out" in one for one in found)
    own = MISSION.replace("tasks:", "geofence: {circle: {center: [47, 8], radius_m: 500}}\ntasks:")
    assert not [one for one in told(checked(carried(json.dumps(plan), own, "field.plan")).findings) if "outside" in one]


@pytest.mark.parametrize(
    ("mission", "content", "finding"),
    [
        (MISSION.replace("flown_by: autopilot, ", ""), PLAN, "m:4:9: a plan is flown by the autopilot (add flown_by"),
        (MISSION.replace("geo", "hold"), PLAN, "m:2:8: a plan of another program needs frame geo (write frame: geo)"),
        (MISSION, PLAN.replace("47.0002 8.0 ", "47.x 8.0 "), "field.waypoints:4:1: '47.x' is not a number"),
        (MISSION, "QGC WPL 110\n0 1 0 16 0 0 0 0 47.0 8.0 488 1\n", "m:4:36: field.waypoints has no mission items"),
        (MISSION, PLAN + "7 0 3 17 0 0 0 0 47.0 8.0 9 1\n", ""),
        (
            MISSION,
            PLAN.replace("6 0 2 20", "6 0 3 17"),
            "m:4:36: warning: item 6, NAV_LOITER_UNLIM, line 8 of field.waypoints never ends: the task runs until",
        ),
        (
            MISSION.replace("}", ", actions: {a: {land: {}}}}"),
            PLAN,
            "m:4:30: fly has a plan and actions (keep one of them)",
        ),
    ],
)
def test_what_is_wrong_with_such_a_task_is_found(mission: str, content: str, finding: str) -> None:
    found = told(checked(carried(content, mission)).findings)
    if finding:
        assert any(one.startswith(finding) for one in found), found
    else:
        assert found == []


def test_a_plan_that_is_named_only_is_refused_and_a_platform_without_plans_says_so() -> None:
    assert "m:4:36: the plan's content is missing (use the mission's file: its plans are sent with it)" in told(
        checked(MISSION).findings
    )
    assert any(
        "accepts no plans: it lacks the capability fly_plan" in one
        for one in told(checked(carried(), "pelican").findings)
    )


def test_a_plan_without_take_off_is_fit_for_what_drives_alone() -> None:
    plan = PLAN.replace("1 0 3 22", "1 0 3 16")
    assert any(
        "without take_off it can only be started in the air" in one for one in told(checked(carried(plan)).findings)
    )
    report = checked(carried(plan), "rover")
    assert not [one for one in told(report.findings) if "started in the air" in one or "above home" in one]
    assert order_of(carried(plan), "rover").sets_off


def test_a_plan_becomes_such_a_mission_by_a_word(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = tmp_path / "field.waypoints"
    plan.write_text(PLAN)
    target = tmp_path / "out" / "m.yaml"
    target.parent.mkdir()
    assert app(["convert", str(plan), str(target), "--as-it-is"], result_action="return_value") == 0
    assert target.read_text() == (
        "gloc3: 1\nmission: field\nframe: geo\ntasks:\n  fly: {flown_by: autopilot, plan: ../field.waypoints}\n"
    )
    assert app(["check", str(target), "--platform", "pelican_rtk"], result_action="return_value") == 0
    assert "fit to fly" in capsys.readouterr().out
    assert app(["show", str(target)], result_action="return_value") == 0
    assert "fly_file ../field.waypoints, 6 items" in capsys.readouterr().out
    assert app(["convert", str(target), str(plan), "--as-it-is"], result_action="return_value") == 2


def test_a_return_on_wings_ends_in_a_circle_and_never_by_itself() -> None:
    high = PLAN.replace(" 10 1", " 50 1").replace(" 25 1", " 50 1")
    order = order_of(carried(high), "plane")
    assert (order.comes_down, order.never_ends) == (False, "item 6, NAV_RETURN_TO_LAUNCH, line 8 of field.waypoints")
    assert order_of(carried(high), "copter").comes_down
