"""The real ArduSub with the simulated ROV on our physics; for a computer that has it on PATH."""

import shutil
from pathlib import Path

import pytest
from tests.flight.diving import SHORT_DIVE

from gloc3.clock import Clock, run_virtual
from gloc3.platform.reader import load_platform
from gloc3_sitl.flight.flight import DEVICES
from gloc3_sitl.flight.fly import FlyOptions, fly_mission

pytestmark = [
    pytest.mark.firmware,
    pytest.mark.sockets,
    pytest.mark.skipif(shutil.which("ardusub") is None, reason="ardusub is not on PATH: see docs/firmware.md"),
]


@pytest.mark.timeout(900)
def test_it_dives_the_mission_that_the_embedded_autopilot_dives(tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    mission.write_text(SHORT_DIVE)
    options = FlyOptions(
        mission=mission, platform="rov", autopilot="ardupilot", is_firmware=True, world="bay", out=tmp_path
    )
    platform = load_platform("rov", is_loading_classes=True, devices=DEVICES)
    report = run_virtual(fly_mission(options, platform, None, Clock.cost_s()))
    assert (report.mission_state, report.reason) == ("done", "")
    assert report.path_rms_error_m is not None
    assert report.path_rms_error_m <= 1.0
    assert "FRAME_CONFIG 2" in (tmp_path / "firmware" / "ardupilot_rov.parm").read_text()
