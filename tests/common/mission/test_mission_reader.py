"""Mission files become missions in NED and are written back, or everything that is wrong in them is told."""

from math import radians

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.documents.document import dump
from gloc3.errors import InputError
from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.mission.examples import example_missions
from gloc3.mission.model.arguments import FollowWaypointsOrder, HeadingOrder, LandOrder, argument_kinds
from gloc3.mission.model.policy import Policy
from gloc3.mission.model.structure import PartialOrder
from gloc3.mission.reading.reader import MissionReferences, load_mission, read_mission
from gloc3.mission.reading.writer import write_mission

EAST = MissionReferences(frames={"hold": LocalFrame(GeoPoint(39.5, 2.6, 5.0), 90.0)})
DESIGN = """\
mission: cargo hold inspection
frame: hold                      # a local frame of the world or platform, or geo
geofence: {polygon_m: [[-2, -2], [20, -2], [20, 12], [-2, 12]], ceiling_m: 8}
on_failure: land
on_link_loss: continue
on_low_battery: return
on_pose_lost: land
tasks:
  depart:
    actions:
      climb:  {take_off: {height_m: 1.5}}
  sweep:
    after: [depart]
    deadline_s: 120
    actions:
      wall:   {follow_waypoints: {waypoints_m: [[2, 1, 2], [18, 1, 2]], speed_m_s: 0.5, heading: {look_at: [10, 0, 3]}}}
      photos: {record_images: {camera: front, every_m: 0.5}, until: wall}     # parallel, ends with wall
  recover:
    after: [sweep]
    actions:
      home:   {return_home: {}}
      down:   {land: {}, after: [home]}
"""


def findings(text: str, surroundings: MissionReferences = EAST) -> list[str]:
    with pytest.raises(InputError) as caught:
        read_mission(text, "m", surroundings)
    return [str(finding) for finding in caught.value.findings]


def test_the_design_s_example_becomes_a_mission_in_ned() -> None:
    mission = read_mission(DESIGN, "m", EAST)
    wall = mission.tasks["sweep"].actions["wall"]
    assert isinstance(wall.order, FollowWaypointsOrder)
    assert wall.order.waypoints_ned_m[1] == pytest.approx((1.0, 18.0, -2.0))
    assert wall.order.heading.look_at_ned_m == pytest.approx((0.0, 10.0, -3.0))
    assert mission.tasks["sweep"].options.deadline_s == 120
    assert mission.tasks["sweep"].actions["photos"].options.until == "wall"
    assert mission.policies.on_failure is Policy.LAND
    assert mission.fence is not None
    assert mission.fence.clearance_m((0.0, 0.0, -1.0)) == pytest.approx(2.0)
    assert mission.text == DESIGN


def test_missions_are_written_back_and_read_again_as_they_were() -> None:
    mission = read_mission(DESIGN, "m", EAST)
    assert read_mission(write_mission(mission), "w", EAST) == mission


@pytest.mark.parametrize("name", sorted(example_missions()))
def test_the_examples_can_be_read(name: str) -> None:
    assert load_mission(name).tasks


def test_geographic_positions_become_ned_of_the_given_origin_with_heights_above_home() -> None:
    text = """\
mission: m
frame: geo
geofence: {circle: {center: [47.0, 8.0], radius_m: 50}, ceiling_m: 30}
tasks:
  t:
    actions:
      go:   {follow_waypoints: {waypoints: [[47.0001, 8, 10]], heading: 45}}
      land: {land: {at: [47, 8.0001]}, after: [go]}
"""
    surroundings = MissionReferences(origin=GeoPoint(47.0, 8.0, 400.0), home_altitude_m=402.0)
    mission = read_mission(text, "m", surroundings)
    go, land = mission.tasks["t"].actions["go"].order, mission.tasks["t"].actions["land"].order
    assert isinstance(go, FollowWaypointsOrder)
    assert go.waypoints_ned_m[0] == pytest.approx((11.12, 0.0, -12.0), abs=0.01)
    assert go.heading == HeadingOrder(mode="fixed", heading_rad=radians(45))
    assert isinstance(land, LandOrder)
    assert land.at_ned_m == pytest.approx((0.0, 7.6, -2.0), abs=0.02)
    assert mission.fence is not None
    assert mission.fence.ceiling_m == 32.0
    sea = read_mission(text.replace("frame: geo", "frame: geo\nheight_above: sea"), "m", surroundings)
    order = sea.tasks["t"].actions["go"].order
    assert isinstance(order, FollowWaypointsOrder)
    assert order.waypoints_ned_m[0][2] == pytest.approx(390.0, abs=0.01)


def test_without_an_origin_the_first_position_of_a_geographic_mission_is_it() -> None:
    text = "{mission: m, frame: geo, tasks: {t: {actions: {a: {go_to: {position: [47.0, 8.0, 10]}}}}}}"
    order = read_mission(text, "m").tasks["t"].actions["a"].order
    assert isinstance(order, FollowWaypointsOrder)
    assert order.waypoints_ned_m[0] == pytest.approx((0.0, 0.0, -10.0), abs=1e-6)


def test_everything_that_is_wrong_is_found_at_once() -> None:
    text = """\
mission: t
frame: hild
on_failur: x
on_link_loss: skip
geofence: {polygon_m: [[-2, -2], [20, 12], [20, -2], [-2, 12]], ceiling_m: 8}
tasks:
  a:
    after: [c]
    actions:
      w: {follow_waypoints: {waypoints_m: [[1, 2]]}, after: [p]}
      p: {record_images: {camera: front}, until: w}
      q: {lnd: {}, untl: w}
      r: {land: , untl: w}
      s: {land: {}, hold: {}}
      t: {}
  b: {after: [a, zz], actions: {x: {take_off: {height_m: -3}}}}
  c: {after: [b], actions: {x: {hold: {}}, y: 3}}
"""
    assert findings(text) == [
        "m:2:8: unknown frame 'hild' (did you mean 'hold'?)",
        "m:3:1: unknown key 'on_failur' (did you mean 'on_failure'?)",
        "m:4:15: on_link_loss: 'skip' is not possible here (known: abort, continue, hold, land, return)",
        "m:7:3: these wait for each other: a -> b -> c -> a (one of them must come first)",
        "m:10:7: these wait for each other: a.w -> a.p -> a.w (one of them must come first)",
        "m:10:44: waypoints_m[0]: expected a list of length 3, got 2",
        "m:11:26: record_images: every_m or every_s must be given",
        "m:12:11: unknown capability 'lnd' (did you mean 'land'?)",
        "m:12:20: unknown capability 'untl' (did you mean 'until'?)",
        "m:13:19: unknown key 'untl' (did you mean 'until'?)",
        "m:14:21: a second capability 'hold' beside 'land' (make it an action of its own)",
        "m:15:10: no capability is given (known: " + ", ".join(sorted(argument_kinds())) + ")",
        "m:16:18: no task 'zz' here (known: a, c)",
        "m:16:58: height_m: expected a number > 0.0 (-3)",
        "m:17:47: y: expected a mapping, got a whole number (3)",
    ]


@pytest.mark.parametrize(
    ("old", "new", "finding"),
    [
        (
            "waypoints_m: [[2, 1, 2], [18, 1, 2]]",
            "waypoints: [[2, 1, 2]]",
            "m:16:34: waypoints is for frame geo; a local frame uses waypoints_m in [x, y, height]",
        ),
        ("waypoints_m: [[2, 1, 2], [18, 1, 2]], ", "", "m:16:34: follow_waypoints: waypoints_m or waypoints must be given"),
        ("[[-2, -2], [20, -2]", "[[-2, -2], [20, 12], [20, -2]", "m:3:23: the polygon crosses itself: side 1 meets side 3"),
        ("[[-2, -2], [20, -2], [20, 12], [-2, 12]]", "[[0, 0], [1, 1], [2, 2]]", "m:3:23: the polygon has no area"),
        ("polygon_m", "polygon", "m:3:12: a local frame uses polygon_m, not polygon"),
        ("{polygon_m", "{circle_m: {center_m: [0, 0], radius_m: 9}, polygon_m",
         "m:3:11: exactly one area is needed, 2 are given (give polygon_m or circle_m)"),
        ("until: wall", "until: wal", "m:17:69: no action 'wal' here (did you mean 'wall'?)"),
        ("after: [home]", "after: [down]", "m:22:34: no action 'down' here (known: home)"),
        ("speed_m_s: 0.5", "speed_m_s: 0", "m:16:84: speed_m_s: expected a number > 0.0 (0)"),
    ],
)  # fmt: skip
def test_each_mistake_is_found_at_its_place(old: str, new: str, finding: str) -> None:
    assert findings(DESIGN.replace(old, new)) == [finding]


@pytest.mark.parametrize(
    ("letter", "code"), [("\\e", "U+001B"), ("\\n", "U+000A"), ("\\u202E", "U+202E"), ("\\u2028", "U+2028")]
)
@pytest.mark.parametrize("key", ["mission", "frame"])
def test_a_name_that_would_steer_a_terminal_is_refused(key: str, letter: str, code: str) -> None:
    names = {"mission": "hold", "frame": "hold", key: f"hold{letter}[2J"}
    text = "".join(f'{name}: "{value}"\n' for name, value in names.items())
    text += "tasks:\n  up: {actions: {a: {take_off: {height_m: 2}}}}\n"
    place = "m:1:10" if key == "mission" else "m:2:8"
    found = findings(text, MissionReferences())
    assert f"{place}: the name has the control character {code} (leave it out)" in found


def test_a_name_may_have_letters_of_any_script() -> None:
    text = DESIGN.replace("cargo hold inspection", "Küste \u05e9\u05dc\u05d5\u05dd 港")
    assert read_mission(text, "m", EAST).name == "Küste \u05e9\u05dc\u05d5\u05dd 港"


def test_actions_that_wait_for_what_they_end_with_are_a_cycle() -> None:
    text = DESIGN.replace("heading: {look_at: [10, 0, 3]}}}", "}, after: [photos]}")
    assert findings(text) == [
        "m:17:7: these wait for each other: sweep.photos -> sweep.wall -> sweep.photos (one of them must come first)"
    ]


def test_too_many_actions_are_refused() -> None:
    many = "".join(f"      a{i}: {{land: }}\n" for i in range(501))
    assert findings(f"mission: m\nframe: hold\ntasks:\n  t:\n    actions:\n{many}") == [
        "m:3:1: more than 500 actions (split the mission)"
    ]


def test_the_partial_order_knows_what_can_be_going_on_at_the_same_time() -> None:
    order = PartialOrder.of(read_mission(DESIGN, "m", EAST))
    assert order.targets == ("depart.climb", "sweep.wall", "sweep.photos", "recover.home", "recover.down")
    assert order.may_overlap("sweep.wall", "sweep.photos")
    assert not order.may_overlap("sweep.photos", "recover.down")
    text = "{mission: m, frame: hold, tasks: {t: {actions: {a: {hold: }, b: {hold: , until: a}, c: {hold: , after: [a]}}}}}"
    order = PartialOrder.of(read_mission(text, "m", EAST))
    assert not order.may_overlap("t.b", "t.c")
    assert order.may_overlap("t.a", "t.b")


POINT = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(0.5, 9))
ARGUMENTS = st.one_of(
    st.builds(lambda h: {"take_off": {"height_m": h}}, st.floats(0.1, 9)),
    st.builds(lambda p, s: {"follow_waypoints": {"waypoints_m": p, "speed_m_s": s}}, st.lists(POINT, min_size=1, max_size=3), st.floats(0.1, 5)),
    st.builds(lambda p: {"go_to": {"position_m": p, "heading": {"look_at": p}}}, POINT),
    st.builds(lambda: {"land": None}),
    st.builds(lambda s: {"record_images": {"camera": "front", "every_s": s, "count": 3}}, st.floats(0.1, 5)),
)  # fmt: skip


@st.composite
def mission_texts(draw: st.DrawFn) -> str:
    tasks: dict[str, object] = {}
    for index in range(draw(st.integers(1, 3))):
        actions: dict[str, object] = {}
        for number in range(draw(st.integers(1, 3))):
            action = dict(draw(ARGUMENTS))
            if actions:
                action["after"] = draw(st.lists(st.sampled_from(sorted(actions)), max_size=2))
            actions[f"a{number}"] = action | draw(st.sampled_from([{}, {"retries": 2}, {"on_failure": "skip"}]))
        tasks[f"t{index}"] = {
            "after": draw(st.lists(st.sampled_from(sorted(tasks) or ["t0"]), max_size=1)) if tasks else [],
            "actions": actions,
        }
    name = draw(st.text(min_size=1, max_size=12).filter(lambda text: text.isprintable()))
    head = {
        "mission": name,
        "frame": "hold",
        "hold_s": draw(st.floats(0, 100)),
        "on_failure": draw(st.sampled_from(list(Policy))).value,
    }
    return dump(head | {"tasks": tasks})  # fmt: skip


@given(mission_texts())
@settings(max_examples=30)
def test_any_mission_is_written_and_read_again_equal(text: str) -> None:
    mission = read_mission(text, "m", EAST)
    assert read_mission(write_mission(mission), "w", EAST) == mission


@given(st.integers(0, len(DESIGN)), st.integers(0, 30), st.text(alphabet="{}[]:,- \nab019.'", max_size=4))
@settings(max_examples=150)
def test_damaged_missions_are_read_or_refused_with_findings(start: int, length: int, middle: str) -> None:
    damaged = DESIGN[:start] + middle + DESIGN[start + length :]
    try:
        read_mission(damaged, "m", EAST)
    except InputError as error:
        found = error.findings
    else:
        return
    assert found
