"""`gloc3 log` as people type it."""

import json
from pathlib import Path
from typing import Any

import pytest

from gloc3.errors import Gloc3Error, Refused
from gloc3.log.cli import app
from gloc3.messages.envelope import Event, Severity

from .samples import POSE, LogInMemory, flight_log

pytestmark = pytest.mark.thorough

LOG = flight_log()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "log.mcap"
    path.write_bytes(LOG)
    return path


def run(*arguments: object) -> Any:
    return app([str(argument) for argument in arguments], exit_on_error=True, result_action="return_value")


def test_info_tells_what_a_log_holds(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", file) == 0
    text = capsys.readouterr().out
    assert "finished" in text
    assert "platform pelican, virtual time" in text
    assert "start 2026-01-01T00:00:00.000+00:00" in text
    assert "duration 8.000 s" in text
    pose = next(line for line in text.splitlines() if line.startswith("pelican/pose "))
    assert pose.split()[1:5] == ["Pose", "81", "10.0", "20"]
    assert pose.endswith("slow")
    assert "camera: OSError: no frame (x1, 2.000 s to 2.000 s)" in text
    assert "and 1 routine" in text


def test_what_a_log_tells_does_not_steer_the_terminal(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = LogInMemory()
    log.send("components/camera/event", Event(severity=Severity.ERROR, text="\x1b[2J\x07no"), 1.0, POSE)
    file.write_bytes(log.close())
    run("info", file)
    text = capsys.readouterr().out
    assert "\ufffd[2J\ufffdno" in text
    assert "\x1b" not in text


def test_info_for_programs_is_json(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", file, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    topics = {topic["topic"]: topic for topic in found["topics"]}
    assert topics["pelican/pose"]["rate_hz"] == pytest.approx(10.0)
    assert found["faults"][0]["cause"] == "OSError: no frame"
    assert found["file"] == "log.mcap"
    assert found["metadata"]["mission"]["name"] == "round"


def test_an_unfinished_log_is_told_by_the_exit_code_and_recovered(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file.write_bytes(LOG[: len(LOG) // 2])
    assert run("info", file) == 1
    assert "NOT FINISHED" in capsys.readouterr().out
    assert run("recover", file) == 0
    out, err = capsys.readouterr()
    assert "log-recovered.mcap: " in out
    assert "lost: the file ends within a record" in err
    assert run("info", file.with_name("log-recovered.mcap")) == 0
    with pytest.raises(Gloc3Error, match="File exists"):
        run("recover", file)


def test_plot_writes_beside_the_log_or_where_it_is_told(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("plot", file) == 0
    assert capsys.readouterr().out.strip() == str(file.with_name("log-path.svg"))
    target = file.with_name("height.png")
    assert run("plot", file, "pose", "position_ned_m[2]", "--out", target) == 0
    assert target.exists()


def test_what_is_not_there_is_said_with_the_nearest(file: Path) -> None:
    with pytest.raises(Refused, match="did you mean 'pose'"):
        run("plot", file, "pos")
    with pytest.raises(Gloc3Error, match="holds no platform file"):
        run("replay", file, "pose")
    with pytest.raises(Gloc3Error, match="No such file"):
        run("info", file.with_name("other.mcap"))


def test_wrong_use_ends_with_a_message(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        run("info")
    assert ended.value.code != 0
    assert "FILE" in capsys.readouterr().err
