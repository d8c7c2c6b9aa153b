"""A number beside its limit never looks like the limit."""

from hypothesis import assume, given
from hypothesis.strategies import floats

from gloc3.amounts import beside, excess

AMOUNTS = floats(-1e4, 1e4, allow_nan=False)


def test_a_value_has_the_digits_that_tell_it_from_its_limit() -> None:
    assert beside(300.0, 30.0) == "300.0"
    assert beside(30.04, 30.0) == "30.04"
    assert beside(29.9996, 30.0) == "29.9996"
    assert beside(30.0, 30.0) == "30.0"
    assert beside(29.6, 30.0, 0) == "29.6"
    assert beside(-0.001, 0.3) == "0.0"


def test_an_excess_is_never_nothing_and_as_advice_enough() -> None:
    amounts = (18.0, 4.31, 0.04, 0.0423, 30.04 - 30.0)
    assert [excess(by) for by in amounts] == ["18.0", "4.3", "0.04", "0.04", "0.04"]
    assert [excess(by, is_enough=True) for by in amounts] == ["18.0", "4.4", "0.04", "0.043", "0.04"]


@given(AMOUNTS, AMOUNTS)
def test_a_value_is_told_on_the_right_side_of_its_limit(value: float, limit: float) -> None:
    assume(abs(value - limit) > 1e-6)
    shown = beside(value, limit)
    rounded_limit = round(limit, len(shown.partition(".")[2]))
    assert float(shown) != rounded_limit
    assert (float(shown) > rounded_limit) == (value > limit)


@given(floats(1e-5, 1e4))
def test_an_excess_is_enough_and_hardly_more(by: float) -> None:
    assert 0.89 * by <= float(excess(by)) <= 1.11 * by
    assert by - 1e-6 <= float(excess(by, is_enough=True)) <= 1.11 * by
