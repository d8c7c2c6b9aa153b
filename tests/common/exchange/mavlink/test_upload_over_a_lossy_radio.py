"""A mission goes up and comes back over a 57,600 baud radio with 20 % loss each way and 300 ms latency."""

from statistics import median

import pytest
from msgspec.structs import replace
from tests.common.exchange.mavlink.ends import RADIO_CONDITIONS
from tests.common.exchange.mavlink.upload_scenario import Figures, scenario

from gloc3.exchange.tunnel.pacing import LinkBudget

pytestmark = pytest.mark.thorough


def assert_nothing_is_lost_or_done_twice(figures: Figures) -> None:
    assert figures.is_equal
    assert figures.handed_over == {0: 1, 1: 1}
    assert sorted(figures.acknowledged) == [0, 1]


def test_20_kilobytes_that_do_not_deflate_go_up_within_15_s_beside_the_status_of_20_components() -> None:
    runs = [scenario(seed) for seed in range(3)]
    for figures in runs:
        assert_nothing_is_lost_or_done_twice(figures)
        assert figures.slowest_status_hz >= 1.0
        assert figures.longest_gap_s <= 5.0
        assert max(figures.status_share, figures.status_share_in_upload) <= 0.15
    assert median(figures.replied_s for figures in runs) <= 15.0


def test_a_mission_in_yaml_is_deflated_and_takes_a_third_of_the_time() -> None:
    figures = scenario(1, is_random=False, duration_s=15.0)
    assert_nothing_is_lost_or_done_twice(figures)
    assert figures.replied_s < 4.0


def test_a_radio_on_which_both_ends_share_one_line_carries_it_too() -> None:
    figures = scenario(2, is_half_duplex=True, duration_s=25.0)
    assert_nothing_is_lost_or_done_twice(figures)
    assert figures.replied_s <= 15.0


def test_a_rate_that_was_configured_far_too_high_is_brought_down() -> None:
    budget = LinkBudget(rate_bit_s=1e6, bits_per_byte=8.0)
    figures = scenario(3, budget=budget, is_half_duplex=True, duration_s=25.0)
    assert_nothing_is_lost_or_done_twice(figures)
    assert figures.replied_s <= 15.0


def test_a_fast_link_is_used() -> None:
    conditions = replace(
        RADIO_CONDITIONS, bandwidth_bit_s=1e6, bits_per_byte=8.0, latency_s=0.02, loss=0.02, queue_bytes=20_000
    )
    figures = scenario(4, budget=LinkBudget(rate_bit_s=1e6, bits_per_byte=8.0), conditions=conditions, duration_s=8.0)
    assert_nothing_is_lost_or_done_twice(figures)
    assert figures.replied_s < 3.0


def test_frames_that_come_twice_late_and_in_another_order_do_no_harm() -> None:
    conditions = replace(RADIO_CONDITIONS, duplicate=0.2, reorder=0.2, jitter_s=0.2)
    figures = scenario(5, conditions=conditions, duration_s=25.0)
    assert_nothing_is_lost_or_done_twice(figures)
    assert figures.replied_s <= 15.0
    assert figures.longest_gap_s <= 5.0
