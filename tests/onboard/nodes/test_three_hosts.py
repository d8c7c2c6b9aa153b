"""One vehicle on three hosts with clocks of their own: the line to one of them breaks in flight, and is whole again."""

from pathlib import Path

import pytest
from tests.onboard.nodes.three_hosts import BASE, BASE_FAULTS, fly, missing

pytestmark = [pytest.mark.sockets, pytest.mark.thorough, pytest.mark.skipif(bool(missing()), reason=missing())]


async def test_the_loss_of_a_host_has_the_vehicle_hold_as_its_policy_says_and_the_mission_goes_on(
    tmp_path: Path,
) -> None:
    (line_down,) = BASE_FAULTS
    report = await fly(tmp_path, BASE, (line_down._replace(for_s=4.0),), print, calm_s=3.0)
    assert report.wrong == []
    assert report.holds == 1
    assert report.mission == "done"
    assert report.rate_hz > 1.0, "the odometry of the base station comes to the vehicle"
    assert max(report.clock_bounds_s.values()) < 0.1
