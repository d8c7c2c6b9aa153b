"""`gloc3 odometry laser`: what it prints, writes and refuses."""

from pathlib import Path

import cv2
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


def test_a_thinned_log_without_times_uses_the_wheels(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A scan each 0.8 m and 30 degrees, as in public logs that have been cut down; the wheels are wrong by a tenth."""
    random, scanner = np.random.default_rng(1), Scanner(HOLD, beams=360, angle_min_rad=-np.pi / 2, angle_span_rad=np.pi)
    poses, wheels = [Planar()], [Planar()]
    for number in range(24):
        step = Planar(0.8, 0.0, -0.5) if number % 4 else Planar(0.4, 0.0, 0.6)
        poses.append(poses[-1] @ step)
        wheels.append(wheels[-1] @ Planar(1.1 * step.x_m, 0.0, 1.1 * step.yaw_rad))
    scans = [" ".join(f"{range_m:.3f}" for range_m in ranges_of(scanner.scan(pose, random))) for pose in poses]
    places = [[f"{p.x_m:.5f} {-p.y_m:.5f} {-p.yaw_rad:.6f}" for p in way] for way in (wheels, poses)]
    raw = [f"LASER_READING 360 {scan} {place} 0" for scan, place in zip(scans, places[0], strict=True)]
    true = [f"FLASER 360 {scan} {place} {place} 1.1e+09 x 1" for scan, place in zip(scans, places[1], strict=True)]
    for name, lines in (("raw.gfs", raw), ("true.log", true)):
        (tmp_path / name).write_text("\n".join(lines).replace(" inf", " 81.9"))
    given = ["laser", str(tmp_path / "raw.gfs"), "--truth", str(tmp_path / "true.log"), "--json", "--align", "origin"]
    assert _call(app, given) == 0
    printed = capsys.readouterr()
    assert "the log has no times in order: its scans count as 1 s apart" in printed.err
    assert msgspec.json.decode(printed.out)["errors"]["absolute_m"]["max"] < 0.1
    assert _call(app, ["laser", str(tmp_path / "true.log")]) == 0
    assert "no wheel odometry" in capsys.readouterr().err


def test_a_map_of_the_drive_is_written_as_map_server_reads_it(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "walk.yaml"
    assert _call(app, ["laser", str(log), "--no-wheels", "--map", str(out), "--truth", str(log), "--json"]) == 0
    printed = capsys.readouterr()
    assert msgspec.json.decode(printed.out)["errors"]["absolute_m"]["max"] < 0.02
    assert "key scans" in printed.err
    about = msgspec.yaml.decode(out.read_bytes())
    assert (about["mode"], about["negate"]) == ("trinary", 0)
    picture = np.array(cv2.imread(str(out.with_name(about["image"])), cv2.IMREAD_UNCHANGED))
    left_m, bottom_m, _ = about["origin"]

    def grey(ahead_m: float, right_m: float) -> int:
        """As map servers place it: the origin is the lower left corner, and north is up."""
        column, up = (int((at - low) / about["resolution"]) for at, low in ((right_m, left_m), (ahead_m, bottom_m)))
        return int(picture[picture.shape[0] - 1 - up, column])

    assert grey(*POSES[10][:2]) == 254
    assert grey(4.0, -1.5) == 254
    side = [grey(ahead_m, -8.5 + 0.05 * step) for ahead_m in (5.975, 6.025) for step in range(-4, 5)]
    assert side.count(0) > 3, "the near side of the box that begins 6 m ahead, to the left"
    assert grey(6.5, -8.5) == 205, "its inside"
    with pytest.raises(Refused, match="exists already"):
        _call(app, ["laser", str(log), "--map", str(out)])
    with pytest.raises(Refused, match=r"ends in \.yaml"):
        _call(app, ["laser", str(log), "--map", str(tmp_path / "walk.png")])
