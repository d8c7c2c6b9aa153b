"""`gloc3 odometry`: what it prints, writes and refuses."""

from pathlib import Path

import msgspec
import pytest

from gloc3.cli.program import _call
from gloc3.errors import InputError, Refused
from gloc3_onboard.cli.odometry import app

TRUTH = "".join(f"{0.1 * n:.1f} {0.2 * n:.2f} {0.001 * n * n:.4f} 0 0 0 0 1\n" for n in range(101))


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    (tmp_path / "truth.txt").write_text(TRUTH)
    return tmp_path / "truth.txt"


def test_a_trajectory_is_compared_in_words_and_in_json(truth: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _call(app, ["compare", str(truth), "--truth", str(truth)]) == 0
    text = capsys.readouterr().out
    assert "absolute (ATE)     rms 0.0000" in text
    assert "relative, 10 m     rms 0.0000" in text
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


LINE = "".join(f"{0.1 * n:.1f} {0.2 * n:.2f} 0 0 0 0 0 1\n" for n in range(101))


def test_along_a_line_the_first_pose_lays_it_over_the_truth_unless_asked_otherwise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "line.txt").write_text(LINE)
    line = str(tmp_path / "line.txt")
    assert _call(app, ["compare", line, "--truth", line]) == 0
    text = capsys.readouterr().out
    assert "attitude         rms 0.0000" in text
    assert "laid over          by the first pose" in text
    with pytest.raises(Refused, match="on one line"):
        _call(app, ["compare", line, "--truth", line, "--align", "begin"])


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--truth", "{0}/none.txt"], "there is no such file"),
        (["--truth", "{0}"], "it is a folder"),
        (["--trajectory", "{0}/none/out.txt"], "there is no folder"),
        (["--trajectory", "{0}"], "it is a folder"),
        (["--over", "nan"], "--over must be above 0"),
    ],
)
@pytest.mark.parametrize("command", ["stereo", "ground", "laser"])
def test_what_is_wrong_is_said_before_the_data_set_is_looked_at(
    tmp_path: Path, command: str, words: list[str], told: str
) -> None:
    with pytest.raises(Refused, match=told):
        _call(app, [command, str(tmp_path / "nothing.log"), *(word.format(tmp_path) for word in words)])


@pytest.mark.parametrize("command", ["stereo", "ground"])
def test_a_file_is_no_folder(truth: Path, command: str) -> None:
    with pytest.raises(InputError, match=f"{truth}: it is a file, not a folder"):
        _call(app, [command, str(truth)])


def test_a_run_without_any_valid_output_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scan = "FLASER 180 " + "81.83 " * 180 + "0 0 0 0 0 0 {0} here {0}\n"
    (tmp_path / "open.log").write_text("".join(scan.format(0.1 * n) for n in range(1, 5)))
    assert _call(app, ["laser", str(tmp_path / "open.log")]) == 1
    assert "no output was valid" in capsys.readouterr().err
