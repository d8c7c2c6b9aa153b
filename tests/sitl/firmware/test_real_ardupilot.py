"""The real ArduCopter on our physics; for a computer that has it on PATH."""

import shutil
from pathlib import Path

import pytest
from tests.sitl.firmware.real_flight import fly

from gloc3.clock import Clock, run_virtual
from gloc3.platform.reader import load_platform
from gloc3_sitl.flight.flight import DEVICES
from gloc3_sitl.flight.fly import FlyOptions, fly_mission

pytestmark = [
    pytest.mark.firmware,
    pytest.mark.sockets,
    pytest.mark.skipif(shutil.which("arducopter") is None, reason="arducopter is not on PATH: see docs/firmware.md"),
]

MISSION = """
mission: a real firmware without satellites
frame: hold
platform: pelican
tasks:
  all:
    actions:
      up: {take_off: {height_m: 1.5}}
      way: {follow_waypoints: {waypoints_m: [[2, 1, 2], [5, 1, 2], [5, 3, 2], [2, 3, 2]], speed_m_s: 0.5}, after: [up]}
      down: {land: {}, after: [way]}
"""


async def test_it_takes_off_flies_four_waypoints_hovers_lands_and_starts_anew(tmp_path: Path) -> None:
    flown = await fly(tmp_path, speed=5.0, hover_s=15.0)
    assert flown.code == 0
    assert flown.hover_rms_m <= 0.3
    assert max(flown.misses_m) <= 0.5
    assert abs(flown.landed_m) < 0.1
    assert flown.factor >= 1.0


def test_without_satellites_it_flies_the_hold_by_the_pose_of_the_onboard_process(tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    mission.write_text(MISSION)
    options = FlyOptions(
        mission=mission,
        platform="pelican",
        autopilot="ardupilot",
        is_firmware=True,
        out=tmp_path,
        faults=("wind=3@30",),
    )
    platform = load_platform("pelican", is_loading_classes=True, devices=DEVICES)
    report = run_virtual(fly_mission(options, platform, None, Clock.cost_s()))
    assert (report.mission_state, report.reason) == ("done", "")
    assert report.waypoints_passed == 4
    assert report.path_rms_error_m is not None
    assert report.path_rms_error_m <= 0.3
    assert "EK3_SRC1_POSXY 6" in (tmp_path / "firmware" / "ardupilot_odometry.parm").read_text()
