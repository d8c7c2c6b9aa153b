"""Programs of their own: pipes that nobody reads, streams that are closed, and Ctrl-C."""

import json
import signal
import subprocess
import sys
from importlib.abc import MetaPathFinder
from pathlib import Path

import pytest
from tests.commands.programs import program

import gloc3.cli
from gloc3.cli import start
from gloc3.log.reader import LogReader

GLOC3 = f"{sys.executable} -m gloc3"

pytestmark = pytest.mark.sockets


def shell(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", line], cwd=folder, capture_output=True, text=True, check=False, timeout=60.0
    )


def test_a_reader_that_stops_reading_ends_the_program_in_silence(tmp_path: Path) -> None:
    done = shell(f"{GLOC3} component describe waypoints --platform pelican --json | head -n 1", tmp_path)
    assert done.returncode in (0, 128 + signal.SIGPIPE)
    assert done.stdout == "{\n"
    assert done.stderr == ""


def test_narration_that_nobody_reads_does_not_end_a_flight(tmp_path: Path) -> None:
    done = shell(f"({GLOC3} fly hop --out out 2>&1 >/dev/null; echo code $? >code) | head -n 1", tmp_path)
    assert "mission running" in done.stdout
    assert (tmp_path / "code").read_text() == "code 0\n"
    assert (tmp_path / "out" / "report.json").exists()


def test_a_program_that_is_started_without_streams_works(tmp_path: Path) -> None:
    done = shell(f"{GLOC3} mission check hop --json >&- 2>&-", tmp_path)
    assert done.returncode == 0


@pytest.mark.parametrize("options", ["", "--commands"])
def test_a_station_that_is_started_without_stdin_ends_with_its_outcome(options: str, tmp_path: Path) -> None:
    station = "station --headless --json --no-record --mission hop --link udpin://127.0.0.1:0 --wait 0.1"
    done = shell(f"{GLOC3} {station} {options} <&-", tmp_path)
    assert json.loads(done.stdout.splitlines()[-1])["outcome"] == "not_heard"
    assert done.returncode == 5


def test_a_full_disk_is_told(tmp_path: Path) -> None:
    done = shell(f"{GLOC3} component list --json >/dev/full", tmp_path)
    assert done.returncode == 2
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_disk_that_fills_up_in_a_flight_is_told_when_it_has_landed(tmp_path: Path) -> None:
    done = shell(f"ulimit -f 280; {GLOC3} fly hop --out out", tmp_path)  # in KiB
    assert done.returncode == 2
    assert "mission done" in done.stderr
    assert done.stderr.splitlines()[-1] == "gloc3 fly: out: the log cannot be written: File too large"
    assert "Traceback" not in done.stderr
    assert (tmp_path / "out" / "report.json").stat().st_size > 0


def test_ctrl_c_in_a_flight_ends_with_130_and_a_whole_log(tmp_path: Path) -> None:
    with program("fly", "patrol", "--out", "out", folder=tmp_path) as fly:
        fly.await_line(lambda line: "climb running" in line)
        fly.interrupt()
        assert fly.end() == 130
        assert fly.lines[-1] == "gloc3 fly: interrupted; the log so far is in out"
    with LogReader(tmp_path / "out" / "log.mcap") as reader:
        assert sum(1 for _ in reader.entries("pose")) > 10
        assert reader.is_finished


def test_ctrl_c_ends_the_simulator_and_the_station(tmp_path: Path) -> None:
    with (
        program("sitl", "--link", "udpin://127.0.0.1:0", folder=tmp_path) as sitl,
        program("station", "--headless", "--link", "udpin://127.0.0.1:0", folder=tmp_path) as station,
    ):
        sitl.await_line(lambda line: "ground link" in line)
        station.await_line(lambda line: "listening" in line)
        sitl.interrupt()
        station.interrupt()
        assert sitl.end() == 0
        assert sitl.lines[-1].startswith("sitl: ended after")
        assert station.end() == 0
        assert station.lines[-1].endswith("stopped")


def test_a_port_that_is_taken_is_told(tmp_path: Path) -> None:
    with program("sitl", "--link", "udpin://127.0.0.1:0", folder=tmp_path) as sitl:
        port = sitl.await_line(lambda line: "ground link" in line).rpartition(" ")[2]
        for command in (
            ["sitl", "--link"],
            ["onboard", "pelican_rtk", "--autopilot"],
            ["station", "--headless", "--link"],
        ):
            with program(*command, f"udpin://127.0.0.1:{port}", folder=tmp_path) as second:
                assert second.end() == 2
                assert second.lines[-1].endswith(f"port {port} is in use by another program")
    assert not list(tmp_path.iterdir())


def test_ctrl_c_while_the_program_loads_is_an_exit_code_too(monkeypatch: pytest.MonkeyPatch) -> None:
    class Pressed(MetaPathFinder):
        def find_spec(self, fullname: str, path: object = None, target: object = None) -> None:
            if fullname == "gloc3.cli.program":
                raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, "gloc3.cli.program", raising=False)
    monkeypatch.delattr(gloc3.cli, "program", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Pressed(), *sys.meta_path])
    with pytest.raises(SystemExit) as ended:
        start.main()
    assert ended.value.code == 130
