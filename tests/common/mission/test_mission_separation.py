"""The ways of several vehicles keep the separation, in space or in time, or the checker says where they do not."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from gloc3.errors import Finding
from gloc3.messages.frames import Vector3
from gloc3.mission.checking.checker import Circumstances, check_text
from gloc3.mission.checking.separation_check import segments_m
from gloc3.platform.platform import Platform

TEXT = """\
mission: crossing
frame: hold
on_failure: land
tasks:
  west:
    platform: pelican
    actions:
      up: {take_off: {height_m: 3}}
      go: {follow_waypoints: {waypoints_m: [[-20, 1, 3], [20, 1, 3]], speed_m_s: 2}, after: [up]}
      end: {land: {}, after: [go]}
  south:
    platform: heron
    actions:
      up: {take_off: {height_m: 3}}
      wait: {hold: {duration_s: 0}, after: [up]}
      go: {follow_waypoints: {waypoints_m: [[0, -20, 3], [0, 20, 3]], speed_m_s: 2}, after: [wait]}
      end: {land: {}, after: [go]}
"""
HERE, THERE = (39.5, 2.6, 5.0), (39.4999, 2.6, 5.0)


def platform(pelican: Platform, name: str, separation_m: float, home: tuple[float, float, float] = HERE) -> Platform:
    frames = {"hold": replace(pelican.frames["hold"], origin=replace(pelican.frames["hold"].origin, geo=home))}
    return replace(pelican, platform=name, frames=frames, limits=replace(pelican.limits, separation_m=separation_m))


def found(
    text: str, pelican: Platform, separation_m: float = 5.0, heron_home: tuple[float, float, float] = THERE
) -> list[Finding]:
    known = {
        "pelican": platform(pelican, "pelican", separation_m),
        "heron": platform(pelican, "heron", separation_m, heron_home),
    }
    report = check_text(text, "crossing.yaml", Circumstances(known=known.get))
    assert report.mission is not None, report.findings
    return [one for one in report.findings if "separation" in one.message]


# The frames' origins are 11 m apart: what the heron's file calls x = 11 is the pelican's origin.
CROSSING = TEXT.replace("[0, -20, 3], [0, 20, 3]", "[11, -20, 3], [11, 20, 3]")


def test_crossing_ways_are_an_error_at_their_place_and_every_hint_would_do(pelican: Platform) -> None:
    finding = next(one for one in found(CROSSING, pelican) if "west.go" in one.message and "south.go" in one.message)
    assert not finding.is_warning
    assert finding.line == CROSSING[: CROSSING.index("go: {follow_waypoints: {waypoints_m: [[11")].count("\n") + 1
    assert "pelican (west.go) and heron (south.go) may come within 0.0 m of each other between" in finding.message
    assert "the separation is 5 m (2.5 m up and down)" in finding.message
    hint = re.match(
        r"start south.go (\d+) s later, or fly south.go ([\d.]+) m higher, or put it after west", finding.hint
    )
    assert hint is not None, finding.hint

    def is_solved(text: str) -> bool:
        return not any("west.go" in one.message and "south.go" in one.message for one in found(text, pelican))

    later_s, higher_m = float(hint[1]), float(hint[2])
    assert is_solved(CROSSING.replace("duration_s: 0", f"duration_s: {later_s:.0f}"))
    assert is_solved(
        CROSSING.replace("[11, -20, 3], [11, 20, 3]", f"[11, -20, {3 + higher_m}], [11, 20, {3 + higher_m}]")
    )
    assert is_solved(CROSSING.replace("    platform: heron\n", "    platform: heron\n    after: [west]\n"))


def test_far_ways_and_platforms_without_a_separation_are_none(pelican: Platform) -> None:
    far = CROSSING.replace("[11, -20, 3], [11, 20, 3]", "[-40, -20, 3], [-40, 20, 3]")
    assert not any("south.go" in one.message for one in found(far, pelican))
    assert found(CROSSING, pelican, separation_m=0.0) == []
    assert found(CROSSING, pelican, heron_home=HERE) != []


def test_who_waits_for_another_vehicle_has_no_end_of_his_time(pelican: Platform) -> None:
    """The heron's part waits for a task of the pelican; its estimate does not know for how long."""
    text = CROSSING.replace(
        "  south:\n",
        "  late:\n    platform: pelican\n    after: [west]\n    actions: {rest: {wait: {duration_s: 1}}}\n  south:\n",
    ).replace("    platform: heron\n", "    platform: heron\n    after: [late]\n")
    text += """\
  again:
    platform: pelican
    after: [late]
    actions:
      rest: {hold: {duration_s: 500}}
      up: {take_off: {height_m: 3}, after: [rest]}
      go: {follow_waypoints: {waypoints_m: [[-20, 1, 3], [20, 1, 3]], speed_m_s: 2}, after: [up]}
      end: {land: {}, after: [go]}
"""
    messages = [one.message for one in found(text, pelican)]
    assert any("again.go" in one and "south.go" in one and "between 4" in one for one in messages), messages


point = st.tuples(*[st.floats(-20.0, 20.0)] * 3)


@given(point, point, point, point)
def test_the_distance_of_two_legs_is_that_of_their_nearest_points(
    a: Vector3, b: Vector3, c: Vector3, d: Vector3
) -> None:
    def at(start: Vector3, end: Vector3, share: float) -> Vector3:
        north, east, down = (p + share * (q - p) for p, q in zip(start, end, strict=True))
        return north, east, down

    shares = [number / 40 for number in range(41)]
    sampled_m = min(
        sum((p - q) ** 2 for p, q in zip(at(a, b, s), at(c, d, t), strict=True)) ** 0.5 for s in shares for t in shares
    )
    assert segments_m(a, b, c, d) == pytest.approx(sampled_m, abs=2.5)
    assert segments_m(a, b, c, d) <= sampled_m + 1e-9
