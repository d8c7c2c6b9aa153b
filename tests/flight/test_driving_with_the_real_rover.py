"""The same mission with ArduPilot's own Rover, on the physics of our rover and our boat, in step with virtual time."""

import shutil
from pathlib import Path

import pytest
from tests.flight.test_driving_missions import MISSION

from gloc3.clock import run_virtual
from gloc3.platform.reader import load_platform
from gloc3_sitl.flight.flight import DEVICES
from gloc3_sitl.flight.fly import FlyOptions, fly_mission

pytestmark = [pytest.mark.firmware, pytest.mark.sockets, pytest.mark.thorough]


@pytest.mark.timeout(900)
@pytest.mark.parametrize(("platform", "rms_m"), [("rover", 0.5), ("boat", 1.5)])
def test_ardupilots_rover_carries_out_the_mission_of_the_embedded_one(
    platform: str, rms_m: float, tmp_path: Path
) -> None:
    if shutil.which("ardurover") is None:
        pytest.skip("ardurover is not on PATH: see docs/firmware.md")
    mission = tmp_path / "mission.yaml"
    mission.write_text(MISSION)
    options = FlyOptions(mission=mission, platform=platform, autopilot="ardupilot", is_firmware=True)
    known = load_platform(platform, is_loading_classes=True, devices=DEVICES)
    report = run_virtual(fly_mission(options, known, None, 0.0))
    assert (report.mission_state, report.reason) == ("done", "")
    assert report.waypoints_passed == report.waypoints == 4
    assert report.path_rms_error_m is not None
    assert report.path_rms_error_m < rms_m
