"""A flight in which processes are killed: the vehicle stays safe, the logs readable, and the mission goes on where it was."""

from pathlib import Path

import pytest
from tests.onboard.nodes.kills import HEIGHT_M, MAIN, fly

pytestmark = [pytest.mark.sockets, pytest.mark.thorough]


async def test_after_a_child_and_the_main_process_are_killed_the_mission_goes_on_where_it_was(tmp_path: Path) -> None:
    report = await fly(tmp_path, ("one", MAIN), 1, (3.0, 4.0), print)
    assert report.kills == {"one": 1, MAIN: 1}
    assert report.mission == "done"
    assert report.most_back_m < 1.0
    assert report.lowest_m > HEIGHT_M - 0.7
    assert report.highest_m < HEIGHT_M + 0.7
    assert report.farthest_m < 1.0
    assert report.unreadable == []
    assert report.logs == 4 + 1 + 4, "of all processes, of the child once more, and of all after the main one"
    assert report.most_lost_s < 2.0
