"""What can neither stop nor turn on the spot gets lines apart from each other, and is refused ways without room to turn."""

from dataclasses import replace
from itertools import pairwise
from math import radians

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


AWAY = "go_to: {position_m: [500, 0, 60]}"
BEGINS_NEAR_HOME = "geofence: {polygon_m: [[-120, -700], [1200, -700], [1200, 700], [-120, 700]]}"


def approach(fence: str, heading_deg: float | None = None, end: str = "arrive: {}") -> list[str]:
    """Errors and warnings about the landing approach."""
    circumstances = replace(PLANE, heading_rad=None if heading_deg is None else radians(heading_deg))
    text = TEXT.replace("ACTION", AWAY).replace("END", end).replace("FRAME", "site").replace("FENCE", fence)
    found = check_text(text, "m", circumstances)
    return [str(one) for one in found.findings if "landing approach" in one.message]


def test_a_landing_approach_that_leaves_the_fence_is_an_error_at_the_landing() -> None:
    (found,) = approach(BEGINS_NEAR_HOME, heading_deg=0.0)
    assert found.startswith("m:7:")
    assert "landing approach leaves the fence or its margin of 30 m, with the runway at 0 degrees" in found
    assert "it begins 400 m before home with a circle of 80 m, and ends 200 m beyond home" in found
    assert "widen the fence by 390 m" in found  # 400 m and the radius of the circle, which stays 30 m inside
    assert approach(BEGINS_NEAR_HOME, heading_deg=180.0) != []  # it begins inside, and rolls out beyond the fence
    assert approach(BEGINS_NEAR_HOME, heading_deg=110.0) == []


def test_an_approach_across_a_keep_out_area_is_an_error() -> None:
    fence = "geofence: {circle_m: {center_m: [0, 0], radius_m: 900}, keep_out: [{circle_m: {center_m: [-200, 0], radius_m: 40}}]}"
    (found,) = approach(fence, heading_deg=0.0)
    assert "landing approach leaves the fence" in found
    assert approach(fence, heading_deg=90.0) == []


def test_an_approach_whose_heading_is_not_known_is_a_warning_that_names_those_that_fit() -> None:
    (found,) = approach(BEGINS_NEAR_HOME)
    assert "warning" in found
    assert "may leave the fence" in found
    assert "take off at 100 to 115 or 245 to 260 degrees, or widen the fence" in found
    small = "geofence: {circle_m: {center_m: [0, 0], radius_m: 400}}"
    (found,) = approach(small)
    assert "warning" not in found
    assert "whatever the heading of the runway" in found


def test_a_circle_that_leaves_the_fence_on_one_side_is_a_warning() -> None:
    """The autopilot chooses the side."""
    fence = "geofence: {polygon_m: [[-600, -600], [1200, -600], [1200, 100], [-600, 100]]}"
    (found,) = approach(fence, heading_deg=0.0)
    assert "warning" in found
    assert "may leave the fence" in found


def test_what_lands_only_by_a_policy_is_warned_of_at_the_fence() -> None:
    (found,) = approach(BEGINS_NEAR_HOME, heading_deg=0.0, end="hold: {for_s: 5}")
    assert found.startswith("m:3:")
    assert "warning" in found
