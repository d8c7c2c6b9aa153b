"""One vehicle on three hosts with clocks of their own: the line to one of them breaks in flight, and is whole again."""

from pathlib import Path

import pytest
from tests.onboard.hosts.namespaces import BASE, VISION, missing
from tests.onboard.hosts.three_hosts import fly, platform
from tests.onboard.hosts.three_hosts_faults import LINE_DOWN

from gloc3.platform.places import ProcessPlace, rows_at
from gloc3.platform.reader import read_platform

pytestmark = [pytest.mark.sockets, pytest.mark.thorough]


def test_a_word_moves_the_odometer_to_another_host() -> None:
    there, here = platform(VISION), platform(BASE)
    changed = [(a, b) for a, b in zip(there.splitlines(), here.splitlines(), strict=True) if a != b]
    assert [a.replace(f"host: {VISION}", f"host: {BASE}") for a, _ in changed] == [b for _, b in changed]
    assert len(changed) == 1
    for text, host in ((there, VISION), (here, BASE)):
        read = read_platform(text.encode(), "p.yaml")
        names = {row.name for row in rows_at(read, ProcessPlace(host))}
        assert "stereo_odometry" in names


async def test_the_loss_of_a_host_has_the_vehicle_hold_as_its_policy_says_and_the_mission_goes_on(
    tmp_path: Path,
) -> None:
    if lack := missing():
        pytest.skip(lack)
    report = await fly(tmp_path, None, (LINE_DOWN._replace(for_s=4.0),), print, 0.5, 1.0)
    (trial,) = report.trials
    assert trial.wrong == []
    assert trial.is_lost
    assert trial.held_at_s > trial.ended_s
    assert report.moving_m_s < 0.3
    assert report.mission == "done"
    assert max(report.clock_bounds_s.values()) < 0.1
