"""One vehicle on three hosts with clocks of their own: the line to one of them breaks in flight, and is whole again."""

from pathlib import Path

import pytest
from tests.onboard.nodes.namespaces import BASE, missing
from tests.onboard.nodes.three_hosts import fly
from tests.onboard.nodes.three_hosts_faults import LINE_DOWN

pytestmark = [pytest.mark.sockets, pytest.mark.thorough]


async def test_the_loss_of_a_host_has_the_vehicle_hold_as_its_policy_says_and_the_mission_goes_on(
    tmp_path: Path,
) -> None:
    if lack := missing():
        pytest.skip(lack)
    report = await fly(tmp_path, BASE, (LINE_DOWN._replace(for_s=4.0),), print, 2.0)
    (trial,) = report.trials
    assert trial.wrong == []
    assert trial.is_lost
    assert trial.held_at_s > trial.ended_s
    assert trial.used_s < 60.0
    assert report.moving_m_s < 0.3
    assert report.mission == "done"
    assert report.rate_hz > 1.0, "the odometry of the base station comes to the vehicle"
    assert report.used_share > 0.2, "and its pose rests on it"
    assert max(report.clock_bounds_s.values()) < 0.1
