"""The laser odometer on logs, of our own and of other people, in short; the whole is in tests/evidence."""

from pathlib import Path

import pytest
from tests.data_folders import LASER_LOGS, OWN

pytestmark = pytest.mark.thorough

HOLD = OWN / "laser" / "hold.log"
"""A drive through the simulated hold."""


@pytest.mark.parametrize(
    ("log", "step"), [pytest.param(HOLD, 3), pytest.param(LASER_LOGS / "mbicp", 26, marks=pytest.mark.outside)]
)
def test_a_displaced_scan_is_found_again_and_neither_control_finds_it(log: Path, step: int) -> None:
    from tests.evidence.laser import OURS, converge

    found = converge(0.2, 45.0, step=step, with_peers=False, dataset=log)
    assert found[OURS]["good"] == 100.0
    assert found["plain point to line"]["good"] < 95.0
    assert found["zero (control)"]["good"] == 0.0


@pytest.mark.parametrize(
    ("log", "over_m", "most_m"),
    [pytest.param(HOLD, 2.0, 0.02), pytest.param(LASER_LOGS / "aces", 10.0, 0.11, marks=pytest.mark.outside)],
)
def test_it_drifts_by_no_more_than_a_hundredth_and_knows_where_it_does_not_know(
    log: Path, over_m: float, most_m: float
) -> None:
    from gloc3.evaluation.metrics import TrajectoryAlignment, evaluate
    from gloc3_onboard.algorithms.scan_matching.planar import Planar
    from gloc3_onboard.cli.odometry_laser import run_laser, trajectory_of
    from gloc3_onboard.datasets.laser_logs import read_laser_log

    logged = read_laser_log(log)
    truth = trajectory_of([scan.pose or Planar() for scan in logged.scans], logged.times_s)
    estimate, cost = run_laser(logged, wheels=True)
    error = evaluate(estimate, truth, TrajectoryAlignment.ORIGIN, over_m).relative_m
    assert error is not None
    assert error.mean < most_m
    assert cost.valid == cost.inputs - 1
