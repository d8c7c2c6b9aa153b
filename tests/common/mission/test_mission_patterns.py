"""Missions ask for ways by their shape, with heights and speeds that are the platform's, whatever the vehicle is."""

from itertools import pairwise
from math import dist, radians

import pytest
from msgspec.structs import replace

from gloc3.errors import InputError
from gloc3.messages.frames import GeoPoint, LocalFrame, Vector3
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.formats import exported, read_plan, to_mission
from gloc3.mission.model.arguments import Dive, DriveOff, FollowWaypointsOrder, LandOrder, ReturnHome, TakeOff
from gloc3.mission.model.model import Mission
from gloc3.mission.model.structure import PartialOrder
from gloc3.mission.reading.reader import MissionReferences, read_mission
from gloc3.platform.limits import Limits
from gloc3.platform.platform import Platform

from .executor_rig import Rig

LOCAL = MissionReferences(
    frames={"hold": LocalFrame(GeoPoint(39.5, 2.6, 5.0), 90.0)},
    limits=Limits(survey_height_m=4.0, survey_speed_m_s=0.7),
)


def order(pattern: str, frame: str = "hold", surroundings: MissionReferences = LOCAL) -> FollowWaypointsOrder:
    """What the component gets; x of the frame points east, y north."""
    text = f"mission: m\nframe: {frame}\ntasks: {{t: {{actions: {{a: {{{pattern}}}}}}}}}\n"
    found = read_mission(text, "m", surroundings).tasks["t"].actions["a"].order
    assert isinstance(found, FollowWaypointsOrder)
    return found


def way(pattern: str) -> list[tuple[float, float, float]]:
    """The waypoints as `(x, y, height)` in the frame, rounded."""
    return [(round(e, 6), round(n, 6), -d) for n, e, d in order(pattern).waypoints_ned_m]


def findings(pattern: str) -> str:
    with pytest.raises(InputError) as caught:
        order(pattern)
    return str(caught.value)


def test_an_area_is_surveyed_in_lines_to_and_fro_along_its_longest_side_beginning_at_its_first_corner() -> None:
    lines = way("survey: {area_m: [[0, 0], [20, 0], [20, 9], [0, 9]], spacing_m: 5}")
    assert lines == [(0, 0, 4), (20, 0, 4), (20, 4.5, 4), (0, 4.5, 4), (0, 9, 4), (20, 9, 4)]
    assert order("survey: {area_m: [[0, 0], [20, 0], [20, 9]], spacing_m: 5}").speed_m_s == 0.7
    assert way("survey: {area_m: [[20, 9], [0, 9], [0, 0], [20, 0]], spacing_m: 20, height_m: 2}")[0] == (20, 9, 2)


def test_the_direction_of_lines_their_margin_and_a_second_time_across_are_as_asked_for() -> None:
    lines = way("survey: {area_m: [[0, 0], [20, 0], [20, 9], [0, 9]], spacing_m: 9, lines_deg: 0, margin_m: 1}")
    assert lines == [(1, 1, 4), (1, 8, 4), (10, 8, 4), (10, 1, 4), (19, 1, 4), (19, 8, 4)]
    crossed = way("survey: {area_m: [[0, 0], [20, 0], [20, 9], [0, 9]], spacing_m: 9, is_crossed: true}")
    assert crossed[:4] == [(0, 0, 4), (20, 0, 4), (20, 9, 4), (0, 9, 4)]
    assert crossed[4:6] == [(0, 9, 4), (0, 0, 4)]
    assert len(crossed) == 4 + 8


def test_the_lines_of_an_area_with_a_bay_stay_inside_it() -> None:
    lines = way(
        "survey: {area_m: [[0, 0], [20, 0], [20, 20], [12, 20], [12, 5], [8, 5], [8, 20], [0, 20]], spacing_m: 9.9}"
    )
    assert [x for x, y, _ in lines if 5 < round(y) < 20] == [20, 12, 8, 0, 0, 8, 12, 20]


def test_no_place_of_an_area_is_farther_from_a_line_than_half_the_spacing() -> None:
    area = [(0.0, 0.0), (30.0, 4.0), (26.0, 25.0), (3.0, 18.0)]
    lines = way(f"survey: {{area_m: {[list(one) for one in area]}, spacing_m: 4, lines_deg: 20}}")
    pairs = list(pairwise(lines))
    for x, y in [(10.0, 8.0), (15.0, 15.0), (24.0, 10.0), (6.0, 14.0), (25.0, 21.0)]:
        assert min(_distance_m((x, y), a[:2], b[:2]) for a, b in pairs) <= 2.01


def _distance_m(point: tuple[float, float], a: tuple[float, ...], b: tuple[float, ...]) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    share = min(max(((point[0] - a[0]) * dx + (point[1] - a[1]) * dy) / max(dx * dx + dy * dy, 1e-12), 0.0), 1.0)
    return dist(point, (a[0] + share * dx, a[1] + share * dy))


def test_a_wall_is_followed_at_a_distance_line_above_line_with_the_nose_towards_it() -> None:
    wall = "follow_wall: {wall_m: [[0, 8], [10, 8]], side: right, standoff_m: 2, heights_m: [1, 4], spacing_m: 2}"
    assert way(wall) == [(0, 6, 1), (10, 6, 1), (10, 6, 2.5), (0, 6, 2.5), (0, 6, 4), (10, 6, 4)]
    assert order(wall).heading.heading_rad == pytest.approx(0.0)  # y of the frame, where the wall is, points north
    left = order(wall.replace("right", "left"))
    assert left.waypoints_ned_m[0][0] == pytest.approx(10.0)
    assert abs(left.heading.heading_rad) == pytest.approx(radians(180.0))
    assert way("follow_wall: {wall_m: [[0, 8], [10, 8]], side: right, standoff_m: 2}") == [(0, 6, 4), (10, 6, 4)]


def test_lines_along_a_wall_may_overlap_by_a_share_of_the_picture_stand_upright_or_be_kept_by_the_scanner() -> None:
    wall = "follow_wall: {wall_m: [[0, 8], [10, 8]], side: right, standoff_m: 2, heights_m: [1, 5], "
    assert len(way(wall + "overlap: 0.5, view_deg: 90}")) == 2 * 3  # 4 m are seen, every second metre a line
    upright = way(wall + "spacing_m: 5, is_upright: true}")
    assert upright == [(0, 6, 1), (0, 6, 5), (5, 6, 5), (5, 6, 1), (10, 6, 1), (10, 6, 5)]
    assert order(wall + "spacing_m: 5, is_measured: true}").wall_distance_m == 2.0


def test_patterns_on_earth_are_laid_in_metres() -> None:
    survey = (
        "survey: {area: [[47.0, 8.0], [47.0, 8.001], [47.0005, 8.001], [47.0005, 8.0]], spacing_m: 30, height_m: 20}"
    )
    points = order(survey, "geo", MissionReferences(origin=GeoPoint(47.0, 8.0, 400.0))).waypoints_ned_m
    assert dist(points[0], points[1]) == pytest.approx(76.1, abs=0.1)
    assert dist(points[1], points[2]) == pytest.approx(55.6 / 2, abs=0.1)
    assert points[0] == pytest.approx((0.0, 0.0, -20.0), abs=0.01)


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("survey: {area_m: [[0, 0], [1, 0], [1, 1]], spacing_m: 1, margin_m: 3}", "no line fits into the area"),
        ("survey: {area_m: [[0, 0], [9999, 0], [0, 9999]], spacing_m: 0.1}", "more than 10,000 lines"),
        ("survey: {spacing_m: 1}", "area_m"),
        ("survey: {area: [[0, 0], [1, 0], [1, 1]], spacing_m: 1}", "area is for frame geo"),
        ("follow_wall: {wall_m: [[1, 1], [1, 1]], side: left, standoff_m: 2}", "both ends of the wall are one place"),
        (
            "follow_wall: {wall_m: [[0, 0], [1, 1]], side: left, standoff_m: 2, heights_m: [1, 3]}",
            "spacing_m is missing",
        ),
        ("transit: {}", "to_m"),
    ],
)
def test_patterns_that_cannot_be_laid_say_why(pattern: str, expected: str) -> None:
    assert expected in findings(pattern)


@pytest.mark.thorough
def test_a_mission_of_many_patterns_is_refused_before_it_takes_long_to_check(pelican: Platform) -> None:
    area = "{survey: {area_m: [[0, 0], [300, 0], [300, 300], [0, 300]], spacing_m: 0.1, height_m: 5}}"
    tasks = "".join(f"  t{number}: {{actions: {{lines: {area}}}}}\n" for number in range(400))
    text = f"mission: many\nframe: hold\ntasks:\n{tasks}"
    found = [str(finding) for finding in check_text(text, "m", Circumstances(platform=pelican)).findings]
    wanted = "m:5:25: the mission has 12,004 waypoints up to here; the limit is 10,000 (split the mission)"
    assert [line for line in found if "waypoints up to" in line] == [wanted]


SAME = """\
mission: the same for all
frame: hold
tasks:
  out:
    actions:
      begin: {depart: {}}
      lines: {survey: {area_m: [[0, 0], [20, 0], [20, 9]], spacing_m: 5}, after: [begin]}
      end:   {arrive: {}, after: [lines], deadline_s: 500}
"""


def on(platform: Platform, text: str = SAME, **limits: float) -> tuple[Platform, Mission]:
    changed = replace(platform, limits=replace(platform.limits, **limits))
    report = check_text(text, "m", Circumstances(platform=changed, home_ned_m=(0.0, 0.0, 0.0)))
    return changed, report.flyable()


def test_one_mission_departs_and_arrives_with_whatever_vehicle_it_is_flown(pelican: Platform) -> None:
    rows = pelican.capabilities
    _, flown = on(pelican, survey_height_m=4.0)
    ground = replace(pelican, capabilities=rows | {"drive_off": replace(rows["take_off"], arguments="drive_off")})
    _, driven = on(ground, survey_height_m=0.0, height_min_m=-1.0)
    diver = replace(ground, capabilities=ground.capabilities | {"dive": replace(rows["take_off"], arguments="dive")})
    _, dived = on(diver, survey_height_m=-5.0, height_min_m=-10.0)
    routes: list[Vector3] = []
    for mission, expected in ((flown, TakeOff(height_m=4.0)), (driven, DriveOff()), (dived, Dive(depth_m=5.0))):
        actions = mission.tasks["out"].actions
        assert actions["begin"].order == expected
        lines = actions["lines"].order
        assert isinstance(lines, FollowWaypointsOrder)
        routes.append(lines.waypoints_ned_m[0])
        assert isinstance(actions["end_return"].order, ReturnHome)
        assert isinstance(actions["end"].order, LandOrder)
        assert actions["end_return"].options.after == ("lines",)
        assert actions["end_return"].options.deadline_s == actions["end"].options.deadline_s == 500
    assert [height for *_, height in routes] == [-4.0, 0.0, 5.0]
    assert len({place[:2] for place in routes}) == 1


def test_a_platform_that_states_no_survey_height_is_told_what_it_lacks(pelican: Platform) -> None:
    with pytest.raises(InputError) as caught:
        on(pelican)
    assert "the platform's file states no limits.survey_height_m" in str(caught.value)


def test_a_pattern_is_flown_by_whoever_follows_waypoints(pelican: Platform) -> None:
    platform, mission = on(pelican, survey_height_m=4.0)
    rig = Rig(platform, mission.text)
    rig.start()
    rig.fly()
    rig.done("out.begin")
    assert [one.capability for one in rig.started] == ["take_off", "follow_waypoints"]
    assert rig.running() == ["out.lines"]
    assert PartialOrder.of(mission).targets[-2:] == ("out.end_return", "out.end")


def test_a_survey_on_earth_becomes_the_waypoints_of_a_plan() -> None:
    text = """\
mission: field
frame: geo
tasks:
  fly:
    actions:
      up:    {take_off: {height_m: 20}}
      lines: {survey: {area: [[47.0, 8.0], [47.0, 8.001], [47.0005, 8.001]], spacing_m: 30, height_m: 20}, after: [up]}
      end:   {arrive: {}, after: [lines]}
"""
    mission = read_mission(text, "m")
    plan, warnings = exported(mission, ".plan", "m")
    back, _ = to_mission(read_plan(plan.encode(), "p"), "p", "p")
    assert not warnings
    assert len(read_mission(back, "b").tasks["fly"].actions["way"].order.waypoints_ned_m) == 5  # type: ignore[attr-defined]


def test_a_mission_in_a_local_frame_becomes_a_plan_where_the_frame_s_place_on_earth_is_known(pelican: Platform) -> None:
    text = """\
mission: hold
frame: hold
geofence: {polygon_m: [[-5, -5], [30, -5], [30, 15], [-5, 15]]}
tasks:
  fly:
    actions:
      up:    {take_off: {height_m: 3}}
      lines: {survey: {area_m: [[2, 2], [20, 2], [20, 10], [2, 10]], spacing_m: 4, height_m: 3}, after: [up]}
      look:  {go_to: {position_m: [5, 5, 4], heading: {look_at: [0, 0, 1]}}, after: [lines]}
      down:  {land: {at_m: [1, 1]}, after: [look]}
"""
    _, mission = on(pelican, text)
    frames = pelican.local_frames()
    plan, _ = exported(mission, ".plan", "m", frames)
    back, _ = to_mission(read_plan(plan.encode(), "p"), "p", "p")
    origin = frames["hold"].origin
    again = read_mission(back, "b", MissionReferences(origin=origin, home_altitude_m=origin.altitude_m))
    flown = [one for action in mission.actions().values() for one in getattr(action.order, "waypoints_ned_m", ())]
    read = [one for action in again.actions().values() for one in getattr(action.order, "waypoints_ned_m", ())]
    assert len(flown) == len(read) == 7
    assert max(dist(a, b) for a, b in zip(flown, read, strict=True)) < 0.02
    assert again.fence is not None
    assert again.fence.clearance_m((0.0, 0.0, -1.0)) == pytest.approx(5.0, abs=0.02)
