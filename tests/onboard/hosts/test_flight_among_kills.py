"""A flight in which processes are killed: the vehicle stays safe, the logs readable, and the mission goes on where it was."""

from pathlib import Path

import pytest
from tests.onboard.hosts.kills import MAIN, fly
from tests.onboard.hosts.kills_told import HEIGHT_M

pytestmark = [pytest.mark.sockets, pytest.mark.thorough]


async def test_after_a_child_and_the_main_process_are_killed_the_mission_goes_on_where_it_was(tmp_path: Path) -> None:
    report = await fly(tmp_path, iter([(1.0, "vehicle/one"), (1.5, MAIN)]), 2, print)
    assert report.kills == {"vehicle/one": 1, MAIN: 1}
    assert report.mission == "done"
    assert report.flown_m > 0.5
    assert report.most_back_m < 1.0
    assert report.lowest_m > HEIGHT_M - 0.7
    assert report.highest_m < HEIGHT_M + 0.7
    assert report.farthest_m < 1.0
    assert report.touch_down_m_s < 1.0
    assert report.unreadable == []
    assert report.most_lost_s < 2.0
    assert report.twice == []
    assert report.outcomes["accepted"] >= 1
