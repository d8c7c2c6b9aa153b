"""The main job over real UDP: three processes fly a mission, and Ctrl-C ends all of them."""

import math
from pathlib import Path

import msgspec
import pytest
from tests.commands.programs import processes_that_mention, program

from gloc3.log.reader import LogReader
from gloc3.platform.reader import load_platform
from gloc3_sitl.demo.demo import sensed
from gloc3_sitl.flight.report import FlightReport

pytestmark = pytest.mark.sockets


def test_each_platform_gets_the_sensors_that_it_uses_from_the_simulated_vehicle() -> None:
    assert sensed(load_platform("auv"), 1, 2) == ["ground_camera=tcp://127.0.0.1:1", "dvl=a50://127.0.0.1:2"]
    assert "imu=autopilot://" in sensed(load_platform("pelican"), 1, 2)


def report_in(out: Path) -> FlightReport:
    return msgspec.json.decode((out / "report.json").read_bytes(), type=FlightReport)


def test_three_processes_fly_a_mission_and_leave_log_report_and_picture(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    with program("demo", "hop", "--out", str(out), folder=tmp_path) as demo:
        assert demo.end() == 0, demo.text
    assert "hop: done" in demo.lines
    assert any("task hop: done" in line for line in demo.lines)
    report = report_in(out)
    assert report.mission_state == "done"
    assert set(report.tasks.values()) == {"done"}
    assert 8.0 < report.flight_time_s < 25.0
    assert report.distance_m > 2.5
    assert report.wall["total_s"] < 60.0
    assert (out / "path.svg").read_text().lstrip().startswith("<?xml")
    for name in ("log.mcap", "truth.mcap"):
        with LogReader(out / name) as reader:
            assert reader.is_finished
            assert not reader.losses()
    assert not processes_that_mention(str(out))


UP_AND_DOWN = """
mission: up and down
frame: hold
tasks: {all: {actions: {up: {take_off: {height_m: 0.8}}, down: {land: {}, after: [up]}}}}
"""


def test_a_platform_without_satellites_flies_by_its_own_cameras_over_real_sockets(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(UP_AND_DOWN)
    out = tmp_path / "demo"
    with program("demo", "m.yaml", "--platform", "pelican", "--out", str(out), folder=tmp_path) as demo:
        assert demo.end() == 0, demo.text
    assert report_in(out).mission_state == "done"
    with LogReader(out / "log.mcap") as reader:
        poses = [entry.envelope for entry in reader.entries("pose")]
    aloft = [one.payload for one in poses if one.payload.is_valid and -one.payload.position_ned_m[2] > 0.4]
    assert aloft
    assert {name for pose in aloft for name in pose.sources} >= {"stereo", "ground", "laser", "tracker"}
    assert all(math.isfinite(value) for one in poses for value in one.payload.position_ned_m)


def test_ctrl_c_in_flight_leaves_no_process_and_a_readable_log_and_says_what_became_of_it(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    with program("demo", "hop", "--out", str(out), folder=tmp_path) as demo:
        demo.await_line(lambda line: "hop.up: running" in line)
        demo.interrupt()
        assert demo.end() == 130, demo.text
    assert not processes_that_mention(str(out))
    assert report_in(out).mission_state == "aborted"
    with LogReader(out / "log.mcap") as reader:
        assert reader.is_finished
        left = [entry.envelope.payload for entry in reader.entries("components/autopilot_driver/status")]
    assert left[-1].state is None, "the driver left in order"


def test_ctrl_c_while_the_processes_start_leaves_nothing_either(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    with program("demo", "hop", "--out", str(out), folder=tmp_path) as demo:
        demo.await_line(lambda line: "listening" in line)
        demo.interrupt()
        assert demo.end() == 130, demo.text
    assert not processes_that_mention(str(out))
