"""Line-of-sight guidance brings a boat onto its way, and keeps it there in a current that it does not know."""

from math import cos, degrees, sin

import pytest

from gloc3.line_of_sight import LineOfSight, corner_speed_m_s, heading_vector, slowed_m_s
from gloc3.messages.frames import Vector3

START, END = (0.0, 0.0, 0.0), (200.0, 0.0, 0.0)


def sail(
    guide: LineOfSight, begin: Vector3, drift_east_m_s: float, seconds: float = 120.0
) -> tuple[list[float], Vector3]:
    """Cross-track errors of a boat of 1.5 m/s that turns at once."""
    (n, e, d), errors = begin, []
    for _ in range(round(seconds * 10)):
        poll = guide.update((n, e, d), 5.0, 0.1)
        errors.append(poll.cross_track_m)
        n, e = n + 0.15 * cos(poll.heading_rad), e + 0.15 * sin(poll.heading_rad) + 0.1 * drift_east_m_s
    return errors, (n, e, d)


def test_it_comes_onto_the_way_from_either_side_without_swinging_across() -> None:
    for aside in (-8.0, 8.0):
        guide = LineOfSight()
        guide.follow(START, END)
        errors, _ = sail(guide, (0.0, aside, 0.0), 0.0)
        assert abs(errors[-1]) < 0.01
        assert all(error * aside > -0.01 for error in errors)


def test_only_the_integral_makes_good_a_current_across() -> None:
    plain, integral = LineOfSight(), LineOfSight(0.06)
    for guide in (plain, integral):
        guide.follow(START, END)
    off, _ = sail(plain, START, 0.4)
    made_good, _ = sail(integral, START, 0.4)
    assert off[-1] == pytest.approx(0.4 / 1.5 * 5.0, rel=0.1), "crab angle times lookahead"
    assert abs(made_good[-1]) < 0.02
    assert max(made_good) < max(off)
    integral.follow(START, END, keeps_drift=True)
    assert integral.crab_m == pytest.approx(off[-1], rel=0.05)
    integral.follow(START, END)
    assert integral.crab_m == 0.0


def test_far_from_the_way_it_steers_straight_for_it_and_says_what_is_left() -> None:
    guide = LineOfSight()
    guide.follow(START, (0.0, 50.0, 0.0))
    poll = guide.update((1000.0, 20.0, 0.0), 5.0, 0.1)
    assert degrees(poll.heading_rad) == pytest.approx(180.0, abs=1.0) or degrees(poll.heading_rad) < -179.0
    assert poll.left_m == pytest.approx(30.0)
    assert poll.cross_track_m == pytest.approx(-1000.0)


def test_speeds_before_corners_and_stops_are_those_that_braking_and_turning_allow() -> None:
    assert slowed_m_s(2.0, 100.0, 0.0, 0.5) == 2.0
    assert slowed_m_s(2.0, 1.0, 0.0, 0.5) == pytest.approx(1.0)
    assert slowed_m_s(2.0, -1.0, 0.5, 0.5) == pytest.approx(0.5)
    assert corner_speed_m_s(0.0, 1.0, 0.3) == float("inf")
    assert corner_speed_m_s(1.5708, 1.0, 0.3) == pytest.approx(0.3 / 0.41421, rel=1e-3)
    assert heading_vector(1.5708, 2.0) == pytest.approx((0.0, 2.0, 0.0), abs=1e-4)
