"""What has both wings and rotors: which ways it flies on which, what that costs, and what it has no room for."""

from math import inf

import pytest
from msgspec.structs import replace

from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.model.legs import Budget, FlightLeg, fly_by_form
from gloc3.platform.limits import Power
from gloc3.platform.reader import load_platform

PLATFORM = load_platform("vtol")
HERE = Circumstances(platform=PLATFORM, home_ned_m=(0.0, 0.0, 0.0))
TEXT = """\
mission: m
frame: FRAME
FENCE
tasks:
  up: {actions: {off: {take_off: {height_m: 40}}}}
  way: {after: [up], actions: {a: {ACTION}}}
  end: {after: [way], actions: {b: {END}}}
"""
LONG = "follow_waypoints: {waypoints_m: [[500, 0, 50], [500, 400, 50]]}"
AROUND_HOME = "geofence: {circle: {center: [47.3977, 8.5456], radius_m: RADIUS}, ceiling_m: 100}"


def report(action: str, end: str = "land: {}", frame: str = "site", fence: str = "") -> CheckReport:
    text = TEXT.replace("ACTION", action).replace("END", end).replace("FRAME", frame).replace("FENCE", fence)
    return check_text(text, "m", HERE)


def problem(action: str, end: str = "land: {}", frame: str = "site", fence: str = "") -> str:
    found = [finding for finding in report(action, end, frame, fence).findings if not finding.is_warning]
    assert found
    return str(found[0])


def legs(length_m: float, by: str | None = None) -> tuple[FlightLeg, ...]:
    budget = Budget.of(PLATFORM.limits, (0.0, 0.0, 0.0))
    return fly_by_form((0.0, 0.0, -50.0), [(length_m, 0.0, -50.0)], 25.0, 0.0, budget, by)


def test_ways_longer_than_two_transitions_are_flown_on_wings_unless_they_say() -> None:
    assert [leg.is_on_wings for leg in legs(500.0)] == [False, True, False]
    assert [leg.is_on_wings for leg in legs(200.0)] == [False]
    assert not any(leg.is_on_wings for leg in legs(500.0, "rotors"))
    assert any(leg.is_on_wings for leg in legs(300.0, "wings"))
    assert legs(500.0, "rotors")[0].duration_s > 100.0


def test_a_way_on_wings_costs_less_than_one_on_rotors_and_its_transitions_what_a_hover_does() -> None:
    power = PLATFORM.power
    assert power is not None
    on_wings = sum(leg.energy_wh(power) for leg in legs(2_000.0))
    assert on_wings < 0.25 * sum(leg.energy_wh(power) for leg in legs(2_000.0, "rotors"))
    begin, way, end = legs(2_000.0)
    assert begin.energy_wh(power) == pytest.approx(2_015.0 * begin.duration_s / 3_600.0)
    assert way.energy_wh(power) == pytest.approx(715.0 * way.duration_s / 3_600.0)
    assert end.energy_wh(power) == begin.energy_wh(power)


def test_others_fly_as_before() -> None:
    copter = load_platform("pelican_rtk").limits
    assert not copter.is_on_wings(inf)
    assert load_platform("plane").limits.is_on_wings(1.0, "rotors")
    leg = FlightLeg(start=(0.0, 0.0, 0.0), end=(30.0, 0.0, 0.0), duration_s=10.0)
    assert leg.energy_wh(Power(hover_w=100.0, battery_wh=10.0, per_m_s_w=12.0)) == pytest.approx(1360.0 / 3600.0)


@pytest.mark.parametrize(
    ("action", "what"),
    [
        (
            "go_to: {position_m: [150, 0, 50], by: wings}",
            "150 m is too short to fly on wings: transitions to wings and to a hover take 240 m",
        ),
        ("go_to: {position_m: [500, 0, 10]}", "10 m high: limit on wings 20 m"),
        ("go_to: {position_m: [500, 0, 50], speed_m_s: 8}", "8 m/s is below the minimum of 20 m/s"),
        ("go_to: {position_m: [500, 0, 50], heading: 90}", "cannot choose its heading"),
        ("follow_waypoints: {waypoints_m: [[500, 0, 50], [520, 0, 50], [520, 40, 50]]}", "long; to turn by"),
    ],
)
def test_what_wings_cannot_fly_is_found_with_a_reason(action: str, what: str) -> None:
    assert what in problem(action)


@pytest.mark.parametrize(
    "action",
    [
        LONG,
        "go_to: {position_m: [80, 0, 5], heading: 90}",
        "follow_waypoints: {waypoints_m: [[40, 0, 5], [40, 10, 5]], hold_s: 5}",
        "follow_waypoints: {waypoints_m: [[500, 0, 10]], by: rotors}",
        "transition: {to: wings}",
    ],
)
def test_what_rotors_can_fly_needs_no_room_to_turn(action: str) -> None:
    assert report(action).is_ok, [str(finding) for finding in report(action).findings]


def test_only_what_has_both_is_told_by_what_to_fly() -> None:
    plane = Circumstances(platform=load_platform("plane"), home_ned_m=(0.0, 0.0, 0.0))
    text = TEXT.replace("ACTION", "go_to: {position_m: [500, 0, 60], by: rotors}").replace("END", "land: {}")
    found = check_text(text.replace("FRAME", "site").replace("FENCE", ""), "m", plane)
    assert "has no choice between wings and rotors" in str(found.findings[0])


def test_it_lands_where_it_hovers() -> None:
    assert "lands where it hovers" in problem(LONG, end="land: {at_m: [10, 10]}")


def test_there_is_room_to_the_fence_for_transitions_and_turns() -> None:
    place = "follow_waypoints: {waypoints: [[47.3977, 8.5456, 60], [47.4030, 8.5456, 60], [47.3977, 8.5476, 60]]}"
    assert report(place, frame="geo", fence=AROUND_HOME.replace("RADIUS", "900")).is_ok
    beyond = problem(place, frame="geo", fence=AROUND_HOME.replace("RADIUS", "660"))
    assert "it stops up to 120 m ahead, outside the fence" in beyond
    polygon = "geofence: {polygon: [[47.3974, 8.53], [47.3974, 8.56], [47.41, 8.56], [47.41, 8.53]], ceiling_m: 100}"
    north = "follow_waypoints: {waypoints: [[47.3977, 8.5456, 60], [47.4030, 8.5456, 60]]}"
    assert "that takes 120 m, to where its nose points" in problem(north, frame="geo", fence=polygon)


def test_the_room_for_transitions_is_the_platforms() -> None:
    assert PLATFORM.limits.transition_m == 120.0
    wide = Circumstances(
        platform=replace(PLATFORM, limits=replace(PLATFORM.limits, transition_m=400.0)), home_ned_m=(0.0, 0.0, 0.0)
    )
    text = TEXT.replace("ACTION", "go_to: {position_m: [500, 0, 50], by: wings}").replace("END", "land: {}")
    found = check_text(text.replace("FRAME", "site").replace("FENCE", ""), "m", wide)
    assert "take 800 m" in str(found.findings[0])
