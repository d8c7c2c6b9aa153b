"""Places that are not plausible: swapped, on another continent, kilometres from the vehicle."""

import json

import pytest

from gloc3.errors import Finding
from gloc3.messages.frames import GeoPoint
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.checking.place_check import distance_m, plan_place_findings
from gloc3.mission.formats import read_wpl

MISSION = """mission: m
frame: geo
tasks:
  t:
    actions:
      up: {take_off: {height_m: 5}}
      way: {follow_waypoints: {waypoints: [[39.55, 2.62, 5], [39.5501, 2.6201, 5]], speed_m_s: 1}, after: [up]}
      down: {land: {}, after: [way]}
"""


def found(text: str, home: GeoPoint | None) -> list[Finding]:
    where = Circumstances(origin=home, home_altitude_m=0.0, home_ned_m=(0.0, 0.0, 0.0)) if home else Circumstances()
    return [one for one in check_text(text, "m", where).findings if "km from" in one.message]


def test_a_distance_over_ground_is_known_from_a_map() -> None:
    assert distance_m((47.0, 8.0), (48.0, 8.0)) == pytest.approx(111_195, abs=5)
    assert distance_m((60.0, 8.0), (60.0, 9.0)) == pytest.approx(55_597, abs=10)


def test_a_mission_beside_the_vehicle_is_not_doubted() -> None:
    assert found(MISSION, GeoPoint(39.5502, 2.6202, 0.0)) == []
    assert found(MISSION, None) == []


def test_a_word_in_the_place_of_positions_is_none() -> None:
    text = MISSION.replace("down: {land: {}, after: [way]}", "down: {transition: {to: rotors}, after: [way]}")
    assert found(text, GeoPoint(39.5502, 2.6202, 0.0)) == []


def test_a_first_place_kilometres_from_home_is_a_warning_and_on_another_continent_an_error() -> None:
    near = found(MISSION, GeoPoint(39.60, 2.62, 0.0))
    assert [str(one) for one in near] == [
        "m:7:44: warning: [39.55, 2.62] is 5.6 km from home (is it the right place?)",
    ]
    far = found(MISSION, GeoPoint(-35.36, 149.16, 0.0))
    assert [(one.is_warning, "16,8" in one.message or "km from home" in one.message) for one in far] == [(False, True)]


def test_swapped_latitude_and_longitude_are_named() -> None:
    swapped = MISSION.replace("[39.55, 2.62, 5]", "[2.62, 39.55, 5]").replace("39.5501, 2.6201", "2.6201, 39.5501")
    finding = found(swapped, GeoPoint(39.5502, 2.6202, 0.0))[0]
    assert "latitude and longitude seem to be swapped" in finding.message
    assert finding.hint.startswith("write latitude first, then longitude: swapped, it is 2")
    assert not finding.is_warning
    one = MISSION.replace("[39.5501, 2.6201, 5]", "[2.6201, 39.5501, 5]")
    assert "from the place before it: latitude and longitude seem to be swapped" in found(one, None)[0].message


def test_a_plan_is_judged_by_its_own_home_with_its_lines() -> None:
    text = "QGC WPL 110\n0 1 0 16 0 0 0 0 {} 100 1\n1 0 3 22 0 0 0 0 0 0 10 1\n2 0 3 16 0 0 0 0 47.0001 8.0001 10 1\n"

    def told(home: str) -> list[str]:
        return [str(one) for one in plan_place_findings(read_wpl(text.format(home), "f"), "f")]

    assert told("47.0 8.0") == []
    assert told("8.0 47.0")[0].startswith("f:4:1: item 2, NAV_WAYPOINT, is ")
    assert "latitude and longitude seem to be swapped" in told("8.0 47.0")[0]
    assert told("47.05 8.0") == ["f:4:1: warning: item 2, NAV_WAYPOINT, is 5.5 km from home (is it the right place?)"]
    outside = read_wpl(text.format("47.0 8.0").replace("47.0001 8.0001", "149.16 -35.36"), "f")
    assert [str(one) for one in plan_place_findings(outside, "f")] == [
        (
            "f:4:1: item 2, NAV_WAYPOINT: 149.16, -35.36 is not a latitude and longitude "
            "(write latitude first, then longitude)"
        )
    ]


def test_a_plan_that_is_flown_as_it_is_is_judged_by_its_home_too() -> None:
    plan = "QGC WPL 110\n0 1 0 16 0 0 0 0 {} 100 1\n1 0 3 22 0 0 0 0 0 0 10 1\n2 0 3 16 0 0 0 0 47.0001 8.0001 10 1\n"

    def judged(home: str) -> list[Finding]:
        carried = json.dumps({"f.waypoints": plan.format(home)})
        text = f"mission: m\nframe: geo\ntasks:\n  fly: {{flown_by: autopilot, plan: {carried}}}\n"
        return found(text, None)

    assert judged("47.0 8.0") == []
    message = judged("8.0 47.0")[0].message
    assert message.startswith("item 2, NAV_WAYPOINT, line 4 of f.waypoints, is ")
    assert "from the place before it: latitude and longitude seem to be swapped" in message
