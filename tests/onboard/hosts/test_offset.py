"""The offset between two computers' clocks, whatever way the delays between them are shared out."""

from math import inf
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gloc3_onboard.hosts.loop import SLEW, Steering
from gloc3_onboard.hosts.offset import DRIFT, UNKNOWN, OffsetFilter


def request(
    found: OffsetFilter, at_s: float, offset_s: float, there_s: float, back_s: float, work_s: float = 0.0
) -> float:
    """One question and its answer; when that came."""
    received_s = at_s + there_s + offset_s
    heard_s = at_s + there_s + work_s + back_s
    found.add(at_s, received_s, received_s + work_s, heard_s)
    return heard_s


def test_before_the_first_answer_nothing_is_known() -> None:
    assert OffsetFilter().estimate(5.0) == UNKNOWN
    assert UNKNOWN.bound_s == inf


@given(
    delays=st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(0.0, 2.0)), min_size=1, max_size=80),
    drift=st.floats(-DRIFT, DRIFT),
    offset_s=st.floats(-1e6, 1e6),
)
def test_it_is_never_farther_off_than_it_says(delays: list[tuple[float, float]], drift: float, offset_s: float) -> None:
    found = OffsetFilter()
    now_s = 0.0
    for there_s, back_s in delays:
        now_s = request(found, now_s + 1.0, offset_s + drift * now_s, there_s, back_s, work_s=0.01)
        known = found.estimate(now_s)
        true_s = offset_s + drift * now_s
        assert abs(known.offset_s - true_s) <= known.bound_s + DRIFT * 6.0 + 1e-6


def test_one_quick_answer_among_slow_ones_counts() -> None:
    found, chance = OffsetFilter(), Random(1)
    for second in range(30):
        request(found, float(second), 100.0, chance.uniform(0.0, 0.4), 0.3)
    request(found, 30.0, 100.0, 0.0004, 0.0006)
    for second in range(31, 40):
        request(found, float(second), 100.0, chance.uniform(0.0, 0.4), 0.3)
    known = found.estimate(40.0)
    assert known.offset_s == pytest.approx(100.0, abs=0.001)
    assert known.bound_s < 0.002
    assert known.age_s == pytest.approx(10.0, abs=0.01)


def test_a_clock_that_was_set_anew_is_believed_at_the_third_answer() -> None:
    found = OffsetFilter()
    for second in range(10):
        request(found, float(second), 100.0, 0.001, 0.001)
    for second in (10, 11):
        request(found, float(second), -50.0, 0.001, 0.001)
        assert found.estimate(float(second)).offset_s == pytest.approx(100.0)
    request(found, 12.0, -50.0, 0.001, 0.001)
    assert found.estimate(12.1).offset_s == pytest.approx(-50.0)


def test_an_offset_is_followed_without_a_step_and_faster_than_clocks_drift() -> None:
    steering = Steering(10.0)
    steering.steer(10.002, 100.0)
    assert steering.offset_s(100.0) == 10.0
    assert steering.offset_s(101.0) == pytest.approx(10.0 + SLEW)
    steering.steer(9.999, 102.0)
    assert steering.offset_s(102.0) == pytest.approx(10.0 + 2.0 * SLEW)
    assert steering.offset_s(103.0) == pytest.approx(10.0 + SLEW)
    assert steering.offset_s(200.0) == 9.999
    assert SLEW > DRIFT
