"""`gloc3 sitl --firmware px4`, `gloc3 onboard` and a station as programs, with a stand-in for PX4's own that flies."""

from pathlib import Path

import pytest
from tests.commands.programs import program
from tests.sitl.firmware.test_firmware_command import program as placeholder

from gloc3.log.reader import LogReader

INSTANCE = 7
STATION = 14767
PLACE = "-35.363261,149.165230,584,0"
"""That of the platform `copter`."""
MISSION = """\
mission: one place
frame: site
on_failure: land
on_link_loss: continue
on_pose_lost: land
tasks:
  depart: {actions: {off: {take_off: {height_m: 2}}}}
  there: {after: [depart], actions: {way: {follow_waypoints: {waypoints_m: [[3, 0, 2]], speed_m_s: 1.5}}}}
  recover: {after: [there], actions: {down: {land: {}}}}
"""


@pytest.mark.sockets
@pytest.mark.thorough
def test_a_mission_is_flown_on_the_bridge_by_the_programs_of_a_user(tmp_path: Path) -> None:
    (tmp_path / "mission.yaml").write_text(MISSION)
    vehicle = ["--firmware-binary", str(placeholder(tmp_path, "px4")), "--firmware-port", str(4560 + INSTANCE)]
    vehicle += ["--world", "open", f"--home={PLACE}", "--out", "sitl"]
    companion = ["--autopilot", f"udpin://127.0.0.1:{14540 + INSTANCE}", "--station", f"udpout://127.0.0.1:{STATION}"]
    ground = ["--headless", "--mission", "mission.yaml", "--link", f"udpin://127.0.0.1:{STATION}"]
    with (
        program("sitl", "--firmware", "px4", *vehicle, folder=tmp_path) as sitl,
        program("onboard", "copter", *companion, "--out", "out", folder=tmp_path) as onboard,
        program("station", *ground, folder=tmp_path) as station,
    ):
        assert station.process.wait(200.0) == 0, "\n".join([station.text, onboard.text, sitl.text])
        for running in (onboard, sitl):
            running.interrupt()
            assert running.end() == 0, running.text
    with LogReader(tmp_path / "sitl" / "truth.mcap") as reader:
        way = [entry.envelope.payload.position_ned_m for entry in reader.entries("sim/truth")]
    assert max(-down for _, _, down in way) == pytest.approx(2.0, abs=0.4)
    assert way[-1] == pytest.approx((3.0, 0.0, 0.0), abs=0.6)
