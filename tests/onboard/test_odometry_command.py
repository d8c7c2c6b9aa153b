"""`gloc3 odometry`: what it prints, writes and refuses."""

from pathlib import Path

import msgspec
import pytest

from gloc3.cli import _call
from gloc3_onboard.odometry_cli import app

TRUTH = "".join(f"{0.1 * n:.1f} {0.2 * n:.2f} {0.001 * n * n:.4f} 0 0 0 0 1\n" for n in range(101))


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    (tmp_path / "truth.txt").write_text(TRUTH)
    return tmp_path / "truth.txt"


def test_a_trajectory_is_compared_in_words_and_in_json(truth: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _call(app, ["compare", str(truth), "--truth", str(truth)]) == 0
    said = capsys.readouterr().out
    assert "absolute (ATE)     rms 0.0000" in said
    assert "relative, 10 m     rms 0.0000" in said
    assert _call(app, ["compare", str(truth), "--truth", str(truth), "--json", "--over", "2"]) == 0
    found = msgspec.json.decode(capsys.readouterr().out)
    assert found["errors"]["relative_over_m"] == 2.0
    assert found["errors"]["poses"] == found["poses"] == 101


def test_the_estimate_is_written_in_tum_form(truth: Path, tmp_path: Path) -> None:
    assert _call(app, ["compare", str(truth), "--trajectory", str(tmp_path / "out.txt")]) == 0
    first = (tmp_path / "out.txt").read_text().splitlines()[1].split()
    assert [float(word) for word in first] == [0.1, 0.2, 0.001, 0.0, 0.0, 0.0, 0.0, 1.0]


def test_a_path_that_is_too_short_for_the_relative_error_is_said(
    truth: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _call(app, ["compare", str(truth), "--truth", str(truth), "--over", "1000"]) == 0
    assert "too short" in capsys.readouterr().out
