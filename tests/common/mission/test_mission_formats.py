"""Plans and waypoint files of other programs are read or refused with a reason, and written back without loss."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs
from tests.data_folders import MISSIONS, OWN

from gloc3.errors import InputError
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.formats import (
    from_mission,
    load_plan,
    mission_text,
    read_plan,
    read_wpl,
    to_mission,
    write_plan,
    write_wpl,
)
from gloc3.mission.formats.from_mission import fence_areas
from gloc3.mission.formats.items import FenceArea, ForeignPlan, MavItem, PlanEntry
from gloc3.mission.reading.reader import read_mission
from gloc3.platform.platform import Platform

OWN_MISSIONS = OWN / "missions"

OUTCOMES: dict[str, tuple[int, int, int] | str] = {
    "mavproxy/cmac-foamy-fence.txt": (0, 5, 0),
    "mavproxy/cmac-foamy-mission-ccw.txt": (11, 0, 0),
    "mavproxy/cmac-foamy-mission-cw.txt": (11, 0, 0),
    "mavproxy/cmac-foamy-rally.txt": (0, 0, 1),
    "mavsdk/mission_planner_sample.txt": (4, 0, 0),
    "mavsdk/qgroundcontrol_sample.plan": (6, 0, 0),
    "mavsdk/qgroundcontrol_sample_with_digicam_control.plan": (1, 0, 0),
    "mavsdk/qgroundcontrol_sample_with_structured_scan.plan": "48:36: item 2, a StructureScan, does not store its items",
    "mavsdk/qgroundcontrol_sample_with_survey.plan": (13, 0, 0),
    "mavsdk/qgroundcontrol_sample_with_survey_missing_items.plan": "33:13: item 2, a survey, lacks its items",
    "mavsdk/qgroundcontrol_sample_with_survey_wrong_version.plan": "303:28: item 2: a survey of version 9 is not supported",
    "mavsdk/qgroundcontrol_sample_without_mission.plan": "1:1: there is no mission in it",
    "mavsdk/qgroundcontrol_sample_wrong_mission_version.plan": "53:20: mission version 7 is not supported, only 2",
    "mavsdk/qgroundcontrol_sample_wrong_overall_version.plan": "60:16: plan file version 42 is not supported, only 1",
    "px4/MC_mission_box.plan": (6, 0, 0),
    "px4/multicopter_mission_geofence_avoid.plan": (5, 9, 0),
    "qgc/MissionPlanner.waypoints": (5, 0, 0),
    "qgc/SectionTest.plan": (5, 0, 0),
}
"""Items without home, fence items and rally points of each file, or why it is refused."""


OWN_OUTCOMES: dict[str, tuple[int, int, int] | str] = {
    "box.plan": (5, 0, 0),
    "box.waypoints": (3, 0, 0),
    "box_and_return_in_a_fence.plan": (5, 5, 0),
    "box_in_a_fence.plan": (5, 5, 1),
    "fence.txt": (0, 4, 0),
    "mission_of_another_version.plan": "6:14: mission version 7 is not supported, only 2",
    "plan_of_another_version.plan": "3:13: plan file version 42 is not supported, only 1",
    "rally.txt": (0, 0, 4),
    "structure_scan.plan": "34:24: item 2, a StructureScan, does not store its items",
    "survey.plan": (8, 0, 0),
    "survey_of_another_version.plan": "35:16: item 2: a survey of version 9 is not supported",
    "survey_without_items.plan": "32:4: item 2, a survey, lacks its items",
    "without_mission.plan": "1:1: there is no mission in it",
}
"""The same of the files that the project has itself."""


def all_files() -> list[Any]:
    """Path and outcome of each file."""
    own = [pytest.param(OWN_MISSIONS / name, outcome, id=name) for name, outcome in OWN_OUTCOMES.items()]
    others = [
        pytest.param(MISSIONS / name, outcome, id=name, marks=pytest.mark.outside) for name, outcome in OUTCOMES.items()
    ]
    return own + others


GOOD = [param for param in all_files() if not isinstance(param.values[1], str)]
BAD = [param for param in all_files() if isinstance(param.values[1], str)]


def refused(read: Any, data: bytes | str) -> list[str]:
    with pytest.raises(InputError) as caught:
        read(data, "f")
    return [str(finding) for finding in caught.value.findings]


def test_every_file_of_our_own_is_in_the_list() -> None:
    assert sorted(path.name for path in OWN_MISSIONS.iterdir()) == sorted(OWN_OUTCOMES)


@pytest.mark.outside
def test_every_real_file_is_in_the_list() -> None:
    assert sorted(str(path.relative_to(MISSIONS)) for path in MISSIONS.rglob("*.*")) == sorted(OUTCOMES)


@pytest.mark.parametrize(("file", "counts"), GOOD)
def test_files_are_read_and_written_without_loss(file: Path, counts: tuple[int, int, int]) -> None:
    plan = load_plan(file)
    assert (len(plan.items), len(plan.fence_items()), len(plan.rally_items())) == counts
    if file.suffix != ".plan":
        assert read_wpl(write_wpl(plan), "again").content == plan.content
        return
    again = write_plan(plan)
    assert read_plan(again, "again").content == plan.content
    if file.name != "SectionTest.plan":  # an old file: its fence is written in the present version
        assert json.loads(again) == json.loads(file.read_text())


@pytest.mark.parametrize(("file", "reason"), BAD)
def test_files_that_cannot_be_read_are_refused_with_a_reason_and_advice(file: Path, reason: str) -> None:
    with pytest.raises(InputError) as caught:
        load_plan(file)
    assert str(caught.value).startswith(f"{file}:{reason}")
    assert all(finding.hint for finding in caught.value.findings)


def test_a_plan_of_qgroundcontrol_that_returns_inside_its_fence_passes_the_check(pelican: Platform) -> None:
    """Home is not known on the ground: what comes down there is not judged against a corner of the fence."""
    _, text, warnings = mission_text(str(OWN_MISSIONS / "box_and_return_in_a_fence.plan"), pelican)
    assert not warnings
    for platform in (pelican, None):
        report = check_text(text, "plan", Circumstances(platform=platform))
        assert [str(finding) for finding in report.findings if "fence" in finding.message] == []
        assert report.is_ok


def test_a_plan_with_a_survey_becomes_a_mission_that_flies_its_lanes(pelican: Platform) -> None:
    _, text, warnings = mission_text(str(OWN_MISSIONS / "survey.plan"), pelican)
    mission = check_text(text, "survey", Circumstances()).flyable()
    assert list(mission.actions()) == ["fly.take_off", "fly.way", "fly.land"]
    assert text.count(", 12.0]") == 4, "the ends of two lanes"
    reported = [str(warning).partition("warning: ")[2] for warning in warnings]
    assert reported == [f"item {n}, DO_SET_CAM_TRIGG_DIST, is left out (add record_images by hand)" for n in (3, 7)]


@pytest.mark.outside
def test_a_real_plan_becomes_a_mission_that_flies_the_same_way(pelican: Platform) -> None:
    _, text, warnings = mission_text(str(MISSIONS / "px4/MC_mission_box.plan"), pelican)
    assert [str(warning).rpartition("warning: ")[2] for warning in warnings] == [
        "item 1, NAV_TAKEOFF: the pitch of 15 degrees is left out",
        "5 m/s is reduced to the platform's 3 m/s",
    ]
    report = check_text(text, "box", Circumstances())
    assert [str(finding) for finding in report.findings] == []
    mission = report.flyable()
    assert list(mission.actions()) == ["fly.take_off", "fly.way", "fly.land"]
    assert report.estimate is not None
    assert 50 < report.estimate.duration_s < 70


PLAN: dict[str, Any] = {
    "fileType": "Plan",
    "version": 1,
    "groundStation": "test",
    "geoFence": {
        "version": 2,
        "circles": [{"inclusion": False, "version": 1, "circle": {"center": [47.0, 8.0], "radius": 5}}],
        "polygons": [{"inclusion": True, "version": 1, "polygon": [[46, 7], [48, 7], [48, 9], [46, 9]]}],
    },
    "rallyPoints": {"version": 2, "points": [[47.0, 8.001, 20.0]]},
    "mission": {
        "version": 2,
        "firmwareType": 12,
        "vehicleType": 2,
        "hoverSpeed": 4,
        "cruiseSpeed": 15,
        "plannedHomePosition": [47.0, 8.0, 400.0],
        "items": [
            {"type": "SimpleItem", "command": 22, "frame": 3, "params": [0, 0, 0, None, 47.0001, 8, 10], "doJumpId": 1},
            {"type": "SimpleItem", "command": 16, "frame": 3, "params": [5, 0, 0, 90, 47.0002, 8, 12], "doJumpId": 2},
            {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 2, -1, 0, 0, 0, 0], "doJumpId": 3},
            {"type": "SimpleItem", "command": 195, "frame": 3, "params": [0, 0, 0, 0, 47, 8, 1], "doJumpId": 4},
            {"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, None, 47.0003, 8, 12], "doJumpId": 5},
            {"type": "SimpleItem", "command": 20, "frame": 2, "params": [0, 0, 0, 0, 0, 0, 0], "doJumpId": 6},
        ],
    },
}  # fmt: skip


def test_a_planned_home_without_an_altitude_is_left_out_with_a_warning() -> None:
    plan = read_plan(changed("mission.plannedHomePosition", [47.0, 8.0, None]), "a.plan")
    assert plan.home is None
    (warning,) = plan.findings
    assert warning.is_warning
    assert warning.line > 0
    assert warning.message == "the planned home has no altitude, and is left out"


def changed(path: str, value: Any) -> str:
    """The plan with something else at a path."""
    plan = json.loads(json.dumps(PLAN))
    *way, last = path.split(".")
    holder = plan
    for step in way:
        holder = holder[int(step) if step.isdigit() else step]
    holder[int(last) if last.isdigit() else last] = value
    return json.dumps(plan, indent=1)


def test_a_plan_becomes_a_chain_of_actions() -> None:
    text, warnings = to_mission(read_plan(json.dumps(PLAN), "p"), "p", "p")
    mission = read_mission(text, "p")
    assert [(target, action.capability) for target, action in mission.actions().items()] == [
        ("fly.take_off", "take_off"),
        ("fly.way", "follow_waypoints"),
        ("fly.way_2", "follow_waypoints"),
        ("fly.stay", "hold"),
        ("fly.way_3", "follow_waypoints"),
        ("fly.home", "return_home"),
        ("fly.land", "land"),
    ]
    assert "speed_m_s: 2.0" in text
    assert "look_at: [47.0, 8.0, 1.0]" in text
    assert "heading: 90.0" in text
    assert "keep_out" in text
    assert [str(warning) for warning in warnings] == [
        "p: warning: the rally points are left out (the mission returns to its home)"
    ]


def test_a_mission_becomes_a_plan_and_comes_back_the_same() -> None:
    text, _ = to_mission(read_plan(json.dumps(PLAN), "p"), "p", "p")
    mission = read_mission(text, "p")
    plan, warnings = from_mission(mission, "p")
    assert warnings == []
    assert read_plan(write_plan(plan), "again").items == plan.items
    again, _ = to_mission(read_plan(write_plan(plan), "again"), "p", "p")
    assert read_mission(again, "again") == mission


def test_the_fence_of_a_mission_is_uploaded_as_mavlink_items() -> None:
    text, _ = to_mission(read_plan(json.dumps(PLAN), "p"), "p", "p")
    geofence = read_mission(text, "p").geofence
    assert geofence is not None
    items = ForeignPlan(entries=(), fence=fence_areas(geofence)).fence_items()
    assert [(item.command, item.params[0]) for item in items] == [(5001, 4.0)] * 4 + [(5004, 5.0)]


def test_a_mission_in_a_local_frame_is_not_made_a_plan() -> None:
    with pytest.raises(InputError, match="frame hold has no place on Earth in a plan"):
        from_mission(read_mission("{mission: m, frame: hold, tasks: {t: {actions: {a: {land: }}}}}", "m"), "m")


@pytest.mark.parametrize(
    ("path", "value", "reason"),
    [
        ("fileType", "Parameters", "not a plan file: fileType is not 'Plan'"),
        ("mission.items", None, "the mission has no list of items"),
        ("mission.items.0", 3, "item 1 is not a mapping"),
        ("mission.items.0.type", "NewItem", "item 1 is of the unknown type 'NewItem'"),
        ("mission.items.0.command", "fly", "the item's command or frame is not a MAVLink number"),
        ("mission.items.0.params", [1, 2], "seven numbers (or null) are expected, or four and a coordinate"),
        ("mission.items.0.params", [1, 2, 3, 4, 5, 6, "7"], "seven numbers (or null) are expected"),
        ("mission.items.0.autoContinue", "yes", "true or false is expected here"),
        ("mission.plannedHomePosition", [95, 0, 0], "95, 0 is not a latitude and longitude"),
        ("mission.plannedHomePosition", [5, 0], "3 numbers are expected here"),
        ("geoFence.version", 3, "fence version 3 is not supported, only 2"),
        ("geoFence.polygons.0.polygon", [[1, 2]], "a polygon of the fence has fewer than three corners"),
        ("geoFence.circles.0.circle.radius", 0, "the circle has no radius"),
        ("rallyPoints.version", 9, "rally points version 9 is not supported"),
        ("rallyPoints.points.0", [1], "3 numbers are expected here"),
    ],
)
def test_plans_that_cannot_be_read_are_refused_with_the_place(path: str, value: Any, reason: str) -> None:
    found = refused(read_plan, changed(path, value))
    assert reason in found[0]
    assert found[0].startswith("f:")
    assert found[0].split(":")[1].isdigit()


@pytest.mark.parametrize(
    ("data", "finding"),
    [
        (b"{", "f:1:2: not JSON: expecting property name enclosed in double quotes"),
        (b"\xff", "f: not UTF-8 text (is this a plan file?)"),
        (b'{"a": NaN}', "f: not usable JSON: NaN is not a finite number"),
        (b"[" * 100_000, "f: not usable JSON: nested too deeply"),
        (b'{"fileType": "Plan", "version": ' + b"1" * 5000 + b"}", "f: not usable JSON: "),
        (b" " * 5_000_001, "f: 5.000001 MB is too large: the limit is 5 MB (is this the right file?)"),
        (b"[]", "f:1:1: not a plan file"),
    ],
    ids=lambda value: repr(value[:12]),
)
def test_what_is_no_plan_at_all_is_refused(data: bytes, finding: str) -> None:
    assert refused(read_plan, data)[0].startswith(finding)


@pytest.mark.parametrize(
    ("items", "reason"),
    [
        ([MavItem(command=177, frame=2)], "item 1, DO_JUMP: cannot be expressed in a mission"),
        (
            [MavItem(command=16, frame=1, x=1.0, y=1.0, z=1.0)],
            "item 1, NAV_WAYPOINT: frame 1 of its position cannot be expressed",
        ),
        ([MavItem(command=22, frame=3, z=-1.0)], "item 1, NAV_TAKEOFF: a take-off to -1 m"),
        (
            [MavItem(command=16, frame=3, x=1.0, y=1.0, z=1.0), MavItem(command=16, frame=10, x=1.0, y=1.0, z=1.0)],
            "item 2, NAV_WAYPOINT: its height counts from ground, those of others from home",
        ),
        ([MavItem(command=206, frame=2)], "it has no item that moves the vehicle"),
    ],
)
def test_what_a_mission_cannot_express_is_told(items: list[MavItem], reason: str) -> None:
    with pytest.raises(InputError) as caught:
        to_mission(ForeignPlan(entries=tuple(PlanEntry(items=(item,)) for item in items), raw={}), "p", "p")
    assert any(reason in str(finding) for finding in caught.value.findings)


@pytest.mark.parametrize(
    ("text", "finding"),
    [
        ("", "f:1:1: not a waypoint file (its first line is 'QGC WPL 110')"),
        ("QGC WPL 100\n", "f:1:1: WPL version 100 is not supported, only 110 (save it as version 110)"),
        ("QGC WPL 110\n0\n", "f:2:1: 1 column, but an item has 12 (index, current, frame"),
        ("QGC WPL 110\n0 1 3\n", "f:2:1: 3 columns, but an item has 12 (index, current, frame"),
        ("QGC WPL 110\n0 0 3 16 0 0 0 x 1 2 3 1\n", "f:2:1: 'x' is not a number"),
        ("QGC WPL 110\n0 0 3 16 0 0 0 inf 1 2 3 1\n", "f:2:1: 'inf' is not a number"),
        ("QGC WPL 110\n0 0 3 1.5 0 0 0 0 1 2 3 1\n", "f:2:1: '1.5' is not a whole number"),
        ("QGC WPL 110\n0 0 3 70000 0 0 0 0 1 2 3 1\n", "f:2:1: frame 3 or command 70000 is not a MAVLink number"),
    ],
)
def test_waypoint_files_that_cannot_be_read_are_refused_by_line(text: str, finding: str) -> None:
    assert refused(read_wpl, text)[0].startswith(finding)


NUMBER = st.floats(allow_nan=False, allow_infinity=False, width=64, min_value=-1e9, max_value=1e9)
DEGREES = st.floats(-90, 90)
ITEMS = st.builds(
    MavItem,
    command=st.integers(0, 4_999) | st.integers(5_101, 65_535),
    frame=st.integers(0, 21),
    params=st.tuples(*[st.none() | NUMBER] * 4),
    x=st.none() | NUMBER,
    y=st.none() | NUMBER,
    z=st.none() | NUMBER,
    is_continued=st.booleans(),
)
PLANS = st.builds(
    lambda items, fence, rally: ForeignPlan(
        entries=tuple(PlanEntry(items=(item,)) for item in items), fence=fence, rally=rally
    ),
    items=st.lists(ITEMS, max_size=5),
    fence=st.lists(
        st.builds(
            FenceArea, is_inclusion=st.booleans(), center=st.tuples(DEGREES, DEGREES), radius_m=st.floats(1, 1e4)
        ),
        max_size=2,
    ).map(tuple),
    rally=st.lists(st.tuples(DEGREES, DEGREES, NUMBER), max_size=2).map(tuple),
)


def _as_numbers(item: MavItem) -> MavItem:
    """An item as a file of waypoints has it: what is not given is 0."""
    p1, p2, p3, p4 = (value or 0.0 for value in item.params)
    return structs.replace(item, params=(p1, p2, p3, p4), x=item.x or 0.0, y=item.y or 0.0, z=item.z or 0.0)


@given(PLANS)
@settings(max_examples=60)
def test_any_plan_is_read_as_it_was_written(plan: ForeignPlan) -> None:
    again = read_plan(write_plan(plan), "f")
    assert (again.items, again.fence, again.rally) == (plan.items, plan.fence, plan.rally)
    assert read_plan(write_plan(again), "f").content == again.content
    written = read_wpl(write_wpl(plan), "f")
    assert written.items == tuple(_as_numbers(item) for item in plan.items)
    assert "nan" not in write_wpl(plan)


@given(st.binary(max_size=80), st.integers(0, 1500), st.text(alphabet='{}[]",:0-19aen\n\t ', max_size=5))
@settings(max_examples=150)
def test_any_bytes_are_read_or_refused(noise: bytes, place: int, middle: str) -> None:
    text = json.dumps(PLAN)
    for read, data in (
        (read_plan, noise),
        (read_wpl, noise),
        (read_wpl, b"QGC WPL 110\n" + noise),
        (read_plan, text[:place] + middle + text[place + len(middle) :]),
        (read_plan, text[:place]),
    ):
        try:
            read(data, "f")
        except InputError as error:
            found = error.findings
        else:
            continue
        assert found
