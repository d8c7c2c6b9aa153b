"""Options of ways are declared once: reader, order, estimate, checks and performers go by the declaration."""

from typing import Any

import pytest

from gloc3.errors import Refused
from gloc3.messages.frames import GeoPoint, LocalFrame
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.model.arguments import FollowWaypoints, FollowWaypointsOrder, GoTo
from gloc3.mission.model.legs import Budget
from gloc3.mission.model.patterns import Transit
from gloc3.mission.model.placement import LocalPlacement
from gloc3.mission.model.waypoint_options import IN_PLANS, given_options, options_of, refuse_unkept, rest_s
from gloc3.platform.reader import load_platform

GIVEN: dict[str, Any] = {"acceptance_m": 1.0, "hold_s": 7.0, "altitude_m": 3.0}


def test_every_option_of_a_way_reaches_its_order() -> None:
    placement = LocalPlacement(LocalFrame(GeoPoint(0.0, 0.0, 0.0), 0.0))
    orders = [
        FollowWaypoints(waypoints_m=((0.0, 0.0, 2.0),), wall_distance_m=2.0, **GIVEN).order(placement),
        GoTo(position_m=(0.0, 0.0, 2.0), **GIVEN).order(placement),
        Transit(to_m=((0.0, 0.0), (5.0, 0.0)), height_m=2.0, **GIVEN).order(placement),
    ]
    for order in orders:
        assert {name: getattr(order, name) for name in GIVEN} == GIVEN
    assert set(options_of(FollowWaypointsOrder)) >= {*GIVEN, "wall_distance_m"}
    assert [name for name, _ in given_options(orders[0])] == [*GIVEN, "wall_distance_m"]
    assert list(given_options(FollowWaypoints(waypoints_m=((0.0, 0.0, 2.0),)))) == []


def test_rests_count_in_the_estimate() -> None:
    order = FollowWaypointsOrder(waypoints_ned_m=((5.0, 0.0, 0.0), (9.0, 0.0, 0.0)), speed_m_s=1.0, hold_s=7.0)
    still = FollowWaypointsOrder(waypoints_ned_m=order.waypoints_ned_m, speed_m_s=1.0)
    start, budget = (0.0, 0.0, 0.0), Budget()
    assert (rest_s(order), order.rest_s, still.rest_s) == (7.0, 7.0, 0.0)
    assert order.time_needed_s(start, budget) - still.time_needed_s(start, budget) == pytest.approx(14.0)


def test_what_a_component_does_not_keep_it_refuses() -> None:
    order = FollowWaypointsOrder(waypoints_ned_m=((5.0, 0.0, 0.0),), speed_m_s=1.0, wall_distance_m=2.0, hold_s=1.0)
    assert {"acceptance_m", "hold_s"} <= IN_PLANS
    refuse_unkept(order, frozenset({"hold_s", "wall_distance_m"}), "it")
    with pytest.raises(Refused, match="what flies on wings cannot keep a distance from a wall"):
        refuse_unkept(order, IN_PLANS, "what flies on wings")


@pytest.mark.parametrize(("platform", "who"), [("plane", "ways of plane"), ("boat", "waypoints of boat")])
def test_what_a_platform_does_not_keep_is_found_before_the_flight(platform: str, who: str) -> None:
    way = "follow_waypoints: {waypoints_m: [[40, 1, 0], [400, 1, 0]], wall_distance_m: 2, altitude_m: 30}"
    mission = f"mission: m\nframe: site\ntasks:\n  go:\n    actions:\n      way:\n        {way}\n"
    report = check_text(mission, "m", Circumstances(platform=load_platform(platform)))
    found = [str(finding) for finding in report.findings if who in finding.message]
    assert len(found) == 2
    assert f"{who} cannot hold a height above ground" in found[0] + found[1]
    assert f"{who} cannot keep a distance from a wall" in found[0] + found[1]
    assert all(line.startswith("m:7:") for line in found)


BOAT = """\
mission: two places
frame: site
tasks:
  away: {actions: {off: {drive_off: {}}}}
  there: {after: [away], actions: {way: {follow_waypoints: {waypoints_m: [[20, 0, 0], [20, 20, 0]]ACCEPTANCE}}}}
"""


@pytest.mark.parametrize(
    ("written", "acceptance_m", "told"), [("", 2.5, 0), (", acceptance_m: 2", 2.0, 0), (", acceptance_m: 0.5", 0.5, 1)]
)
def test_the_acceptance_is_the_platforms_and_much_less_is_warned_of(
    written: str, acceptance_m: float, told: int
) -> None:
    report = check_text(BOAT.replace("ACCEPTANCE", written), "m", Circumstances(platform=load_platform("boat")))
    assert report.is_ok
    order = report.flyable().actions()["there.way"].order
    assert isinstance(order, FollowWaypointsOrder)
    assert order.acceptance_m == acceptance_m
    found = [finding for finding in report.findings if "may pass no waypoint" in finding.message]
    assert [(finding.line, finding.is_warning) for finding in found] == [(5, True)] * told
