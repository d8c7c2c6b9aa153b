"""`gloc3 odometry laser`: what it prints, writes and refuses."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from tests.onboard.algorithms.scan_matching.rays import HOLD, Scanner

from gloc3.cli.program import _call
from gloc3.errors import Refused
from gloc3_onboard.algorithms.scan_matching.planar import Planar
from gloc3_onboard.algorithms.scan_matching.scan_points import ranges_of
from gloc3_onboard.cli.odometry import app

POSES = [Planar(0.1 * number, 0.02 * number, 0.03 * number) for number in range(30)]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A corrected log on CARMEN's axes (y to the left), with times of this century."""
    random, scanner = np.random.default_rng(1), Scanner(HOLD, beams=360, angle_min_rad=-np.pi / 2, angle_span_rad=np.pi)
    lines = []
    for number, pose in enumerate(POSES):
        ranges = " ".join(f"{range_m:.4f}" for range_m in ranges_of(scanner.scan(pose, random)))
        place = f"{pose.x_m:.5f} {-pose.y_m:.5f} {-pose.yaw_rad:.6f}"
        lines.append(f"FLASER 360 {ranges} {place} {place} {1134864642.914187 + 0.2 * number:.6f} host 99.0\n")
    (tmp_path / "walk.log").write_text("".join(lines).replace(" inf", " 81.9"))
    return tmp_path / "walk.log"


def test_a_log_is_run_and_compared_with_the_poses_of_a_corrected_one(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        _call(app, ["laser", str(log.parent), "--truth", str(log), "--json", "--over", "1", "--align", "origin"]) == 0
    )
    found = msgspec.json.decode(capsys.readouterr().out)
    assert found["run"]["inputs"] == 30
    assert found["run"]["valid"] == 29
    assert found["errors"]["absolute_m"]["max"] < 0.02
    assert found["errors"]["absolute_deg"]["max"] < 0.5


def test_the_trajectory_has_the_times_and_the_axes_of_the_log(log: Path, tmp_path: Path) -> None:
    assert _call(app, ["laser", str(log), "--no-wheels", "--trajectory", str(tmp_path / "out.txt")]) == 0
    rows = np.array(
        [[float(word) for word in line.split()] for line in (tmp_path / "out.txt").read_text().splitlines()]
    )
    assert rows[1, 0] == pytest.approx(1134864643.114187, abs=1e-6)
    np.testing.assert_allclose(rows[-1, 1:4], [POSES[-1].x_m, -POSES[-1].y_m, 0.0], atol=0.02)


def test_a_truth_without_the_same_scans_or_times_is_refused(log: Path, tmp_path: Path) -> None:
    (tmp_path / "other.log").write_text("FLASER 3 1 1 1 0 0 0 0 0 0 1.0 h 1.0\nFLASER 3 1 1 1 0 0 0 0 0 0 1.0 h 1.0\n")
    with pytest.raises(Refused, match="no times to compare them by"):
        _call(app, ["laser", str(log), "--truth", str(tmp_path / "other.log")])
    with pytest.raises(Refused, match="--range-max"):
        _call(app, ["laser", str(log), "--range-max", "0"])
