"""`go_to: {plan: true}` and `explore` before the flight: who can do it, where, and by which component."""

import pytest

from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.model.exploring import ExploreOrder
from gloc3.mission.model.model import FIND_WAY
from gloc3.platform.reader import load_platform

FENCE = """geofence: {polygon_m: [[-2.9, -2.9], [20.9, -2.9], [20.9, 12.9], [-2.9, 12.9]], ceiling_m: 8
  , keep_out: [{polygon_m: [[5, -2], [6, -2], [6, 8], [5, 8]]}]}
"""


def checked(action: str, platform: str | None = "pelican", fence: str = FENCE) -> CheckReport:
    mission = f"""mission: m
frame: hold
{fence}on_failure: land
tasks:
  up: {{actions: {{climb: {{take_off: {{height_m: 1.5}}}}}}}}
  there: {{after: [up], actions: {{way: {{{action}}}}}}}
  end: {{after: [there], actions: {{down: {{land: {{}}}}}}}}
"""
    known = None if platform is None else load_platform(platform)
    return check_text(mission, "m", Circumstances(platform=known, home_ned_m=(0.0, 0.0, 0.0)))


def messages(report: CheckReport) -> list[str]:
    return [one.message for one in report.findings if not one.is_warning]


def test_a_planned_way_may_lead_around_what_the_straight_one_crosses() -> None:
    straight = checked("go_to: {position_m: [10, 0, 1.5]}")
    assert messages(straight) == ["the straight path to way's end leaves the fence or its margin of 0.5 m"]
    planned = checked("go_to: {position_m: [10, 0, 1.5], plan: true}")
    assert planned.is_ok, messages(planned)
    assert planned.mission is not None
    assert planned.mission.actions()["there.way"].ability == FIND_WAY
    assert messages(checked("go_to: {position_m: [30, 0, 1.5], plan: true}"))


def test_a_vehicle_without_a_scanner_plans_no_way_and_explores_nothing() -> None:
    (found,) = messages(checked("go_to: {position_m: [3, 0, 1.5], plan: true}", "hummingbird"))
    assert found == "waypoints of hummingbird cannot plan a way around obstacles"
    assert "unknown capability 'explore'" in messages(checked("explore: {}", "hummingbird"))
    assert checked("go_to: {position_m: [3, 0, 1.5], plan: false}", "hummingbird").is_ok


def test_what_a_planned_way_does_not_keep_is_found() -> None:
    (found,) = messages(checked("go_to: {position_m: [3, 0, 1.5], plan: true, hold_s: 3}"))
    assert found == "navigator of pelican cannot hold at waypoints"


@pytest.mark.parametrize("heading", ["hold", "90", "{look_at: [0, 5, 1.5]}"])
def test_a_planned_way_cannot_choose_its_heading(heading: str) -> None:
    (found,) = messages(checked(f"go_to: {{position_m: [3, 0, 1.5], plan: true, heading: {heading}}}"))
    assert found == "navigator of pelican cannot point elsewhere than along its way"
    assert checked("go_to: {position_m: [3, 0, 1.5], plan: true, heading: along}").is_ok


def test_an_exploration_has_an_area_or_a_fence_and_a_height_and_a_speed_that_the_platform_allows() -> None:
    report = checked("explore: {}")
    assert report.is_ok, messages(report)
    assert report.mission is not None
    order = report.mission.actions()["there.way"].order
    assert order == ExploreOrder(down_m=-1.5, speed_m_s=1.0, duration_s=300.0)
    assert report.estimate is not None
    assert report.estimate.duration_s > 300.0
    nowhere = checked("explore: {}", fence="")
    assert messages(nowhere) == ["nothing says where to explore: it has no area, and the mission no geofence"]
    area = checked("explore: {area_m: [[0, 0], [4, 0], [4, 4]], duration_s: 60}", fence="")
    assert area.is_ok, messages(area)
    assert area.mission is not None
    assert getattr(area.mission.actions()["there.way"].order, "area_ne_m", ()) == pytest.approx(
        [(0, 0), (4, 0), (4, -4)]
    )
    assert messages(checked("explore: {speed_m_s: 9}")) == ["9 m/s exceeds the platform's limit of 3 m/s"]


@pytest.mark.parametrize(
    ("area", "said"),
    [
        ("[[0, 0], [4, 4], [0, 4], [4, 0]]", "the polygon crosses itself"),
        ("[[0, 0], [4, 0], [8, 0]]", "the polygon "),
        ("[[30, 0], [40, 0], [40, 10]]", "all of the area to explore is outside the fence"),
        ("[[21, -9], [40, -9], [40, 20], [21, 20]]", "all of the area to explore is outside the fence"),
    ],
)
def test_an_exploration_of_an_impossible_area_is_found(area: str, said: str) -> None:
    (found,) = messages(checked(f"explore: {{area_m: {area}}}"))
    assert said in found


@pytest.mark.parametrize(
    "area",
    ["[[0, 0], [4, 0], [4, 4]]", "[[-9, -9], [40, -9], [40, 40], [-9, 40]]", "[[15, 0], [40, 0], [40, 10], [15, 10]]"],
)
def test_an_exploration_may_reach_beyond_the_fence(area: str) -> None:
    assert checked(f"explore: {{area_m: {area}}}").is_ok


def test_for_an_unknown_vehicle_both_are_read() -> None:
    assert checked("go_to: {position_m: [10, 0, 1.5], plan: true}", None).is_ok
    assert checked("explore: {}", None).is_ok
