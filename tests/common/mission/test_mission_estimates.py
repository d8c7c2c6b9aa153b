"""Estimates where guards may leave something out and loops may end early, and where contingencies may begin."""

import pytest

from gloc3.mission.checking.checker import CheckReport, Circumstances, check_text
from gloc3.mission.checking.estimate import about
from gloc3.mission.showing.picture import picture
from gloc3.mission.showing.show import drawing
from gloc3.platform.platform import Platform
from gloc3.platform.reader import read_platform

from .conftest import PELICAN

MISSION = """\
mission: laps
frame: hold
tasks:
  depart: {actions: {climb: {take_off: {height_m: 2}}}}
  laps:
    after: [depart]
    LOOP
    actions:
      out:  {go_to: {position_m: [10, 0, 2]}}
      back: {go_to: {position_m: [0, 0, 2]}, after: [out]}
      look: {go_to: {position_m: [0, 4, 2]}, after: [back], GUARD}
  end: {after: [laps], actions: {down: {land: {}}}}
"""
ONCE = MISSION.replace("    LOOP\n", "").replace(", GUARD", "")
GUARD = "when: {battery: {above: 0.5}}"
LOOP = "repeat: {times: 4, until: {battery: {below: 0.4}}}"


def checked(text: str, platform: Platform) -> CheckReport:
    report = check_text(text, "m", Circumstances(platform=platform, home_ned_m=(0.0, 0.0, 0.0)))
    assert report.mission is not None, report.findings
    return report


def reported(report: CheckReport) -> list[str]:
    return [f"{'warning: ' if one.is_warning else ''}{one.message}" for one in report.findings]


def length_m(platform: Platform, loop: str = "", guard: str = "") -> tuple[float, float]:
    text = ONCE.replace("    actions:\n      out", f"    {loop}\n    actions:\n      out") if loop else ONCE
    figures = checked(text.replace("after: [back]", f"after: [back], {guard}") if guard else text, platform).estimate
    assert figures is not None
    return (figures.least or figures).length_m, figures.length_m


def test_what_a_guard_may_leave_out_and_a_loop_may_not_do_makes_the_estimate_a_range(pelican: Platform) -> None:
    up_and_down_m = 4.0
    assert length_m(pelican) == pytest.approx((up_and_down_m + 24, up_and_down_m + 24))
    assert length_m(pelican, guard=GUARD) == pytest.approx((up_and_down_m + 20, up_and_down_m + 24))
    again_m = 116**0.5 + 10 + 4  # from where the first lap has ended
    most_m = up_and_down_m + 24 + 3 * again_m
    assert length_m(pelican, loop=LOOP) == pytest.approx((up_and_down_m + 24, most_m))
    assert length_m(pelican, loop=LOOP, guard=GUARD) == pytest.approx((up_and_down_m + 20, most_m))
    assert length_m(pelican, loop="repeat: {times: 4}") == pytest.approx((most_m, most_m)), "nothing ends it early"


def test_a_guard_that_waits_or_fails_leaves_nothing_out(pelican: Platform) -> None:
    for otherwise in ("fail", "wait, deadline_s: 60"):
        least_m, most_m = length_m(pelican, guard=f"{GUARD}, otherwise: {otherwise}")
        assert least_m == most_m


def test_the_range_is_told_by_check_show_and_picture(pelican: Platform) -> None:
    report = checked(ONCE.replace("after: [back]", f"after: [back], {GUARD}"), pelican)
    assert report.estimate is not None
    words = about(report.estimate)
    assert words == "about 33 to 37 s, 24 to 28 m, 1.7 to 1.9 Wh"
    assert words.split(" Wh")[0] in drawing(report, {}, pelican)
    assert words in picture(report)
    figures = report.as_dict()["estimate"]
    assert figures["least"]["length_m"] == 24.0
    assert figures["length_m"] == 28.0


def test_a_deadline_that_only_a_skipped_action_or_an_early_end_keeps_is_a_warning(pelican: Platform) -> None:
    guarded = ONCE.replace("after: [back]", f"after: [back], {GUARD}").replace(
        "after: [depart]\n", "after: [depart]\n    DUE\n"
    )
    assert reported(checked(guarded.replace("DUE", "deadline_s: 23"), pelican)) == [
        "warning: up to 25 s may be needed, but deadline_s is 23"
    ]
    assert reported(checked(guarded.replace("DUE", "deadline_s: 5"), pelican)) == [
        "about 21 s are needed, but deadline_s is 5"
    ]
    whole = ONCE.replace("after: [depart]\n", f"after: [depart]\n    {GUARD}\n    deadline_s: 5\n")
    assert "about 25 s are needed, but deadline_s is 5" in reported(checked(whole, pelican)), "where it is done at all"


def test_more_energy_than_there_is_counts_as_a_warning_where_a_loop_may_end_before(pelican: Platform) -> None:
    small = read_platform(PELICAN.replace("battery_wh: 71", "battery_wh: 4"), "p")
    looped = ONCE.replace("    actions:\n      out", f"    {LOOP}\n    actions:\n      out")
    (found,) = (one for one in checked(looped, small).findings if "Wh" in one.message)
    assert found.is_warning
    assert "may be needed, but only 3.0 Wh" in found.message


READY = """\
mission: m
frame: hold
geofence: {polygon_m: [[-3, -3], [20, -3], [20, 20], [14, 20], [14, 3], [-3, 3]], ceiling_m: 9}
on_low_battery: {task: refuge, then: return}
tasks:
  depart: {actions: {climb: {take_off: {height_m: 2}}}}
  out: {after: [depart], actions: {go: {follow_waypoints: {waypoints_m: [[17, 0, 2], [17, 18, 2], [17, 0, 2]]}}}}
  end: {after: [out], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
contingencies:
  refuge: {actions: {away: {transit: {to_m: [[X, 0]], height_m: 2}}}}
"""


CORNER = """\
mission: m
frame: hold
geofence: {polygon_m: [[-3, -3], [20, -3], [20, 20], [14, 20], [14, 3], [-3, 3]], ceiling_m: 9}
tasks:
  depart: {actions: {climb: {take_off: {height_m: 2}}}}
  out:
    after: [depart]
    actions:
      corner: {go_to: {position_m: [17, 0, 2]}, GUARD}
      far:    {go_to: {position_m: [17, 18, 2]}, after: [corner]}
  end: {after: [out], actions: {down: {land: {}}}}
"""


def test_where_the_way_past_what_a_guard_leaves_out_leaves_the_fence_is_warned_of(pelican: Platform) -> None:
    assert reported(checked(CORNER.replace(", GUARD", ""), pelican)) == []
    report = checked(CORNER.replace("GUARD", GUARD), pelican)
    assert report.is_ok
    assert reported(report) == [
        "warning: the straight path to far's end leaves the fence or its margin of 0.5 m, if guards skip all that they can"
    ]


def test_a_contingency_that_cannot_be_flown_to_straight_from_everywhere_is_warned_of(pelican: Platform) -> None:
    assert reported(checked(READY.replace("X", "17"), pelican)) == []
    assert reported(checked(READY.replace("X", "0"), pelican)) == [
        "warning: from the end of a leg of out.go the straight path to refuge.away leaves the fence"
    ]


def test_a_contingency_for_a_low_battery_that_the_reserve_is_too_small_for_is_warned_of() -> None:
    small = read_platform(PELICAN.replace("battery_wh: 71, reserve: 0.25", "battery_wh: 16, reserve: 0.09"), "p")
    found = reported(checked(READY.replace("X", "17"), small))
    assert "warning: from the farthest place refuge takes 1.6 Wh, more than the reserve of 1.4 Wh" in found


def test_the_picture_draws_what_is_ready_from_its_first_waypoint_on(pelican: Platform) -> None:
    drawn = picture(checked(READY.replace("[[X, 0]]", "[[17, 0], [17, 5]]"), pelican))
    assert "<title>refuge.away</title>" in drawn
