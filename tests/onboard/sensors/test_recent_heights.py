"""Heights by the time of a picture or a scan: steps are followed, and a broken sensor is not believed."""

from collections.abc import Iterable
from math import isnan

import numpy as np
import pytest

from gloc3_onboard.sensors.checks.recent import RecentHeights


def heard(heights_m: Iterable[float]) -> list[float]:
    """What is taken for the height at the time of each, at 20 Hz."""
    heights, found = RecentHeights(0.2), []
    for number, height_m in enumerate(heights_m):
        heights.put(0.05 * number, height_m)
        found.append(heights.at(0.05 * number))
    return found


def test_a_step_of_the_floor_counts_once_two_more_heights_confirm_it() -> None:
    found = heard([2.0] * 10 + [1.2] * 10)
    assert found[10:12] == [2.0, 2.0]
    assert found[12:] == [1.2] * 8


def test_a_box_below_is_seen_at_both_of_its_edges() -> None:
    found = heard([2.0] * 10 + [1.2] * 6 + [2.0] * 10)
    assert found[13] == pytest.approx(1.2)
    assert found[20:] == [2.0] * 6


def test_a_single_height_that_is_wrong_is_left_out() -> None:
    assert heard([2.0] * 10 + [7.0] + [2.0] * 10) == [2.0] * 21


def test_heights_that_leap_all_the_time_are_not_believed() -> None:
    random = np.random.default_rng(1)
    found = heard([2.0] * 20 + (2.0 + 5.0 * random.standard_normal(200)).tolist())
    assert all(height_m == pytest.approx(2.0) for height_m in found[:23])
    assert all(isnan(height_m) for height_m in found[30:])


def test_a_climb_is_followed() -> None:
    climb = (1.0 + 0.05 * 2.5 * np.arange(60)).tolist()
    assert heard(climb) == climb


def test_high_up_the_slant_of_a_tilting_body_is_no_leap() -> None:
    slant = (30.0 / np.cos(0.5 * np.sin(0.3 * np.arange(60)))).tolist()
    assert heard(slant) == slant
