"""`gloc3 fly` in virtual time: what it says, what it leaves, and how it ends."""

from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.evidence.marker import compare

from gloc3.cli.program import run
from gloc3.log.reader import LogReader

pytestmark = pytest.mark.flight

PICTURES = """
mission: over the marker
frame: hold
tasks:
  all:
    actions:
      up: {take_off: {height_m: 1.5}}
      way: {follow_waypoints: {waypoints_m: [[7, 1, 2], [12, 1, 2]], speed_m_s: 1.5}, after: [up]}
      photos: {record_images: {camera: ground, every_m: 0.3}, after: [up], until: way}
      down: {land: {}, after: [way]}
"""

RTK = ("--platform", "pelican_rtk")
"""Whose pose needs no pictures."""

PLAN = {
    "fileType": "Plan",
    "version": 1,
    "groundStation": "QGroundControl",
    "geoFence": {"circles": [], "polygons": [], "version": 2},
    "rallyPoints": {"points": [], "version": 2},
    "mission": {
        "version": 2,
        "firmwareType": 12,
        "vehicleType": 2,
        "cruiseSpeed": 3,
        "hoverSpeed": 2,
        "plannedHomePosition": [47.397742, 8.545594, 488],
        "items": [
            {
                "type": "SimpleItem",
                "autoContinue": True,
                "command": command,
                "doJumpId": number,
                "frame": 3,
                "params": [0, 0, 0, None, latitude, 8.545594, height],
            }
            for number, (command, latitude, height) in enumerate(
                [(22, 47.397742, 3.0), (16, 47.397787, 3.0), (21, 47.397787, 0.0)], 1
            )
        ],
    },
}


def fly(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, Any, str]:
    """The exit code, the report, and what was narrated."""
    code = run(["fly", *arguments, "--json"])
    captured = capsys.readouterr()
    return code, msgspec.json.decode(captured.out), captured.err


def test_a_mission_leaves_log_report_and_picture_and_is_narrated(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, report, reported = fly(capsys, "hop", "--out", str(tmp_path), "--seed", "3")
    assert code == 0
    assert (report["mission"], report["mission_state"], report["seed"]) == ("hop", "done", 3)
    assert report["tasks"]["hop.down"] == "done"
    assert 8.0 < report["flight_time_s"] < report["mission_time_s"] < 25.0
    assert report["battery_remaining"] < 1.0
    assert set(report["wall"]) == {"total_s", "setup_s", "flight_s", "simulated_s", "real_time_factor"}
    assert msgspec.json.decode((tmp_path / "report.json").read_bytes()) == report
    assert "hop.up running" in reported
    assert "mission done" in reported
    assert "<svg" in (tmp_path / "path.svg").read_text()
    assert run(["log", "plot", str(tmp_path), "--autopilot", str(tmp_path / "flight_001.ulg")]) == 0
    assert "which agree by 0.99" in capsys.readouterr().out
    with LogReader(tmp_path / "log.mcap") as reader:
        assert reader.is_finished
        assert not reader.losses()
        assert set(reader.attachments) >= {"platform.yaml", "mission.yaml"}


def test_pictures_show_the_floor_marker_where_the_truth_says_so(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "mission.yaml").write_text(PICTURES)
    code, report, _ = fly(capsys, str(tmp_path / "mission.yaml"), *RTK, "--out", str(tmp_path), "--quiet")
    assert code == 0, report
    seen = compare(tmp_path)
    assert seen["images"] == report["images"] >= 10
    assert seen["must"] >= 3, "the flight passes over the marker"
    assert seen["images"] - seen["must"] >= 3, "and comes from beside it"
    assert seen["shown"] == seen["must"]
    assert seen["false"] == 0
    assert (tmp_path / "mission.yaml").read_text() == PICTURES, "a flight never writes over what is not its own"


def test_a_plan_of_another_program_flies_at_its_own_place(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "box.plan").write_bytes(msgspec.json.encode(PLAN))
    out = tmp_path / "out"
    code, report, _ = fly(capsys, str(tmp_path / "box.plan"), "--out", str(out), "--autopilot", "ardupilot")
    assert code == 0, report
    assert (report["waypoints"], report["waypoints_passed"]) == (1, 1)
    with LogReader(out / "log.mcap") as reader:
        last = [entry.envelope.payload for entry in reader.entries("pose")][-1]
    assert last.origin_geo[0] == pytest.approx(47.3977, abs=1e-3)
    assert run(["mission", "check", str(out / "mission-converted.yaml"), "--platform", "pelican"]) == 0


def test_a_mission_that_fails_ends_with_1_and_says_why(capsys: pytest.CaptureFixture[str]) -> None:
    code, report, _ = fly(capsys, "hop", "--fault", "battery=0.05@5")
    assert code == 1
    assert report["mission_state"] != "done"
    assert report["reason"]


def test_a_flight_that_never_starts_ends_with_1_and_a_report(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, report, _ = fly(capsys, "hop", "--fault", "cable_loss@0", "--out", str(tmp_path))
    assert code == 1
    assert report["mission_state"] == "failed"
    assert report["reason"].startswith("not started: pelican is not ready; missing: the autopilot")
    assert report["flight_time_s"] == 0.0
    assert (tmp_path / "report.json").exists()


def test_a_fault_that_does_not_fit_the_platform_is_wrong_use(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["fly", "hop", "--fault", "crash:nosuch@3"]) == 2
    assert "has no component 'nosuch'" in capsys.readouterr().err


def test_the_report_for_a_person_names_what_was_kept(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert run(["fly", "hop", "--quiet", "--out", str(tmp_path)]) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith("hop: done\n  flown ")
    assert captured.out.endswith(f"kept     log.mcap, report.json, path.svg, the autopilot's log in {tmp_path}\n")
    assert captured.err == ""


@pytest.mark.parametrize("style", ["px4", "ardupilot"])
def test_a_copter_of_any_make_flies_in_simulation_as_its_platform_file_says_it_is_set_up(
    style: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "up_and_down.yaml"
    file.write_text(
        "mission: up and down\nframe: site\ntasks:\n  all:\n    actions:\n      up: {take_off: {height_m: 3}}\n"
        "      down: {land: {}, after: [up]}\n"
    )
    code, report, told = fly(capsys, str(file), "--platform", "copter", "--autopilot", style)
    assert (code, report["mission_state"]) == (0, "done"), told
