"""A 57,600 baud radio with loss behind the router: nothing starves, and what the radio loses is found missing in time."""

import pytest
from tests.onboard.radio_scenario import LOSS, scenario

pytestmark = pytest.mark.thorough


def test_reports_commands_a_mission_and_a_plan_share_a_bad_radio_with_a_stream_that_is_too_much_for_it() -> None:
    figures = scenario(1, busy_s=24.0)
    assert figures.slowest_stream_hz >= 1.0
    assert figures.heartbeat_gap_s < 4.5
    assert figures.slowest_report_hz >= 1.0
    assert figures.is_equal, "mission and plan arrive as they were sent"
    assert figures.mission_s < 15.0
    assert figures.plan_s < 30.0
    assert (figures.commands, figures.unanswered, figures.ran_twice) == (12, 0, 0)
    assert figures.slowest_answer_s < 4.0, "within the eight attempts of the protocol"
    assert 0.95 < figures.used < 1.0 + LOSS / 2, "the line is full, and not more than that"
    assert figures.overfilled == 0
    assert 4.0 <= figures.command_gives_up_s < 5.0
    assert figures.plan_gives_up_s < 15.0
    assert figures.back_s < 5.0
