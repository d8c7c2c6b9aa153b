"""What can neither stop nor turn on the spot gets lines apart from each other, and is refused ways without room to turn."""

from itertools import pairwise

import pytest

from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.model.arguments import FollowWaypointsOrder
from gloc3.platform.reader import load_platform

PLANE = Circumstances(platform=load_platform("plane"), home_ned_m=(0.0, 0.0, 0.0))
TEXT = """\
mission: m
frame: FRAME
FENCE
tasks:
  up: {actions: {off: {depart: {}}}}
  way: {after: [up], actions: {a: {ACTION}}}
  end: {after: [way], actions: {b: {END}}}
"""
FIELD = "survey: {area_m: [[300, 100], [700, 100], [700, 500], [300, 500]], spacing_m: 50}"


def report(action: str, end: str = "arrive: {}", frame: str = "site", fence: str = "") -> CheckReport:
    text = TEXT.replace("ACTION", action).replace("END", end).replace("FRAME", frame).replace("FENCE", fence)
    return check_text(text, "m", PLANE)


def problem(action: str, end: str = "arrive: {}", frame: str = "site", fence: str = "") -> str:
    found = [finding for finding in report(action, end, frame, fence).findings if not finding.is_warning]
    assert found
    return str(found[0])


def test_lines_that_are_nearer_than_a_turn_come_in_an_order_in_which_each_is_a_turn_from_the_one_before() -> None:
    found = report(FIELD)
    assert found.is_ok
    assert found.mission is not None
    order = found.mission.actions()["way.a"].order
    assert isinstance(order, FollowWaypointsOrder)
    wests = [-place[1] for place in order.waypoints_ned_m]
    lines = [round(one) for one, other in zip(wests[::2], wests[1::2], strict=True) if abs(one - other) < 0.01]
    assert sorted(lines) == list(range(100, 501, 50))
    assert min(abs(one - other) for one, other in pairwise(lines)) >= 160
    assert order.speed_m_s == 23.0


def test_its_room_to_turn_may_be_told_and_what_has_none_is_flown_line_by_line() -> None:
    reported = report(FIELD.replace("spacing_m: 50", "spacing_m: 50, turn_m: 0"))
    assert "leg 3 is 50 m long; to turn by 90 and 90 degrees at its ends with a radius of 80 m takes 160 m" in str(
        reported.findings[0]
    )
    narrow = "survey: {area_m: [[300, 100], [700, 100], [700, 200], [300, 200]], spacing_m: 50}"
    assert "m:6:" in problem(narrow)
    assert "leg 3 is 50 m long" in problem(narrow)


@pytest.mark.parametrize(
    ("action", "what"),
    [
        (
            "follow_waypoints: {waypoints_m: [[500, 0, 60]], speed_m_s: 12}",
            "12 m/s is below the minimum of 18 m/s that keeps it",
        ),
        ("follow_waypoints: {waypoints_m: [[500, 0, 60]], heading: 90}", "cannot choose its heading"),
        ("follow_waypoints: {waypoints_m: [[500, 0, 60], [700, 0, 119]]}", "59 m up or down on 200 m"),
        ("follow_waypoints: {waypoints_m: [[500, 0, 10]]}", "waypoint 1 is 10.0 m above home; the platform's limit is"),
        ("go_to: {position_m: [500, 0, 60], speed_m_s: 40}", "40 m/s exceeds"),
    ],
)
def test_what_it_cannot_fly_is_found_with_a_reason(action: str, what: str) -> None:
    assert what in problem(action)


def test_it_lands_where_its_autopilot_lands_and_is_kept_inside_by_its_autopilots_fence() -> None:
    away = "go_to: {position_m: [500, 0, 60]}"
    assert "at home, along its runway" in problem(away, end="land: {at_m: [10, 10]}")
    fence = "geofence: {circle_m: {center_m: [0, 0], radius_m: 900}}"
    fenced = report(away, fence=fence)
    assert fenced.is_ok
    assert fenced.findings == ()
    nowhere = "has no fence in frame hall, which has no place on Earth in the platform file"
    hall = Circumstances(platform=PLANE.platform, frames={"hall": LocalFrame(GeoPoint(47.0, 8.0, 0.0), 0.0)})
    text = TEXT.replace("ACTION", away).replace("END", "arrive: {}").replace("FRAME", "hall").replace("FENCE", fence)
    assert any(nowhere in str(one) for one in check_text(text, "m", hall).findings)


def test_where_it_turns_or_circles_there_is_room_to_the_fence() -> None:
    place = "go_to: {position: [47.4030, 8.5456, 60]}"
    circle = "geofence: {{circle: {{center: [47.3977, 8.5456], radius_m: {}}}, ceiling_m: 100}}"
    home = PLANE.platform
    assert home is not None
    assert report(place, frame="geo", fence=circle.format(900)).is_ok
    assert "inside the fence, and it circles there: that takes 80 m" in problem(
        place, frame="geo", fence=circle.format(650)
    )
