"""The laser odometer on logs, of our own and of other people, in short; the whole is in tests/evidence."""

from pathlib import Path

import msgspec
import numpy as np
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


def test_its_errors_are_within_what_it_claims_in_the_tails_too() -> None:
    """Real logs have things that are no walls: in a rendered hold with noise, the 95 % bound has to hold for 99 %."""
    from gloc3.messages.frames import wrap_pi
    from gloc3_onboard.algorithms.scan_matching.laser_odometer import LaserOdometer
    from gloc3_onboard.algorithms.scan_matching.scan_points import ranges_of
    from gloc3_onboard.datasets.laser_logs import read_laser_log

    log, squares = read_laser_log(HOLD), []
    truth = {t_s: logged.pose for t_s, logged in zip(log.times_s, log.scans, strict=True)}
    for seed in range(3):
        random, odometer = np.random.default_rng(seed), LaserOdometer()
        for t_s, logged in zip(log.times_s, log.scans, strict=True):
            ranges = ranges_of(logged.scan)
            noisy = np.where(
                ranges < 0.99 * logged.scan.range_max_m, ranges + 0.02 * random.normal(size=len(ranges)), ranges
            )
            scan = msgspec.structs.replace(logged.scan, ranges_m=noisy.astype("<f4").tobytes())
            found = odometer.update(scan, t_s, guess=logged.wheels)
            begin, end = truth[found.reference_t_s], truth[t_s]
            if found.is_valid and not found.is_degenerate and begin is not None and end is not None:
                x, y, yaw = begin.inverse() @ end
                off = np.array((found.motion.x_m - x, found.motion.y_m - y, wrap_pi(found.motion.yaw_rad - yaw)))
                squares.append(float(off @ np.linalg.solve(found.covariance, off)))
    # d^T C^-1 d against chi-square, 3 degrees of freedom: 7.81 at 95 %, 16.27 at 99.9 %.
    assert len(squares) > 250
    assert np.mean(np.array(squares) < 7.81) >= 0.99
    assert max(squares) < 16.27
