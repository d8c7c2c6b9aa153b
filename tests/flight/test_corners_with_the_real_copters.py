"""Corners with the real ArduCopter and the real PX4, on the physics of our Pelican, in step with virtual time."""

import shutil
from pathlib import Path

import pytest
from tests.flight.missions import mission
from tests.flight.test_corners_and_stops import BOX, FENCE

from gloc3.clock import run_virtual
from gloc3.platform.reader import load_platform
from gloc3_sitl.flight.flight import DEVICES
from gloc3_sitl.flight.fly import FlyOptions, fly_mission

pytestmark = [pytest.mark.firmware, pytest.mark.sockets, pytest.mark.thorough]

PATH_M = 0.5
"""Largest path error; without the acceleration in the setpoints it is 1 m and more."""


@pytest.mark.timeout(600)
@pytest.mark.parametrize(("program", "family"), [("arducopter", "ardupilot"), ("px4", "px4")])
def test_a_box_at_3_m_s_is_flown_without_flying_past_its_corners(program: str, family: str, tmp_path: Path) -> None:
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not on PATH: see docs/firmware.md")
    file = tmp_path / "mission.yaml"
    file.write_text(mission(BOX, fence=FENCE, on_low_battery="land", on_pose_lost="land"))
    options = FlyOptions(mission=file, platform="pelican_rtk", autopilot=family, is_firmware=True)
    known = load_platform("pelican_rtk", is_loading_classes=True, devices=DEVICES)
    report = run_virtual(fly_mission(options, known, None, 0.0))
    assert (report.mission_state, report.reason) == ("done", "")
    assert report.path_max_error_m is not None
    assert report.path_max_error_m < PATH_M
