"""The laser odometer on scans of other people, in short; the whole is in tests/evidence."""

from pathlib import Path

import pytest

DATA = Path(__file__).parents[5] / "shared" / "data" / "lidar"
pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(not DATA.is_dir(), reason="the data sets are not beside the project"),
]


def test_a_displaced_scan_is_found_again_and_neither_control_finds_it() -> None:
    from tests.evidence.laser import OURS, converge

    found = converge(0.2, 45.0, step=26, with_peers=False)
    assert found[OURS]["good"] == 100.0
    assert found["plain point to line"]["good"] < 95.0
    assert found["zero (control)"]["good"] == 0.0


def test_in_long_corridors_it_drifts_by_no_more_than_a_hundredth_and_knows_where_it_does_not_know() -> None:
    from gloc3.evaluation.metrics import Alignment, evaluate
    from gloc3_onboard.algorithms.scan_matching.planar import Planar
    from gloc3_onboard.cli.odometry_laser import run_laser, trajectory_of
    from gloc3_onboard.datasets.laser_logs import read_laser_log

    log = read_laser_log(DATA / "aces")
    truth = trajectory_of([scan.pose or Planar() for scan in log.scans], log.times_s)
    estimate, cost = run_laser(log, wheels=True)
    error = evaluate(estimate, truth, Alignment.ORIGIN, 10.0).relative_m
    assert error is not None
    assert error.mean < 0.11
    assert cost.valid == cost.inputs - 1
