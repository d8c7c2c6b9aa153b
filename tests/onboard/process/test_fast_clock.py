"""A simulation at five times real time, with an onboard process and a station in real time: the mission is not started."""

from pathlib import Path

import pytest
from tests.commands.programs import program

MISSION = """\
mission: up and down
frame: site
on_failure: land
on_link_loss: continue
on_low_battery: land
on_pose_lost: land
tasks:
  hop: {actions: {off: {take_off: {height_m: 2}}, down: {land: {}, after: [off]}}}
"""
PLACE = "-35.363261,149.165230,584,0"
"""That of the platform `copter`."""
COMPANION, STATION = 14787, 14788


@pytest.mark.sockets
@pytest.mark.thorough
def test_the_onboard_process_refuses_to_start_on_a_clock_that_runs_five_times_as_fast(tmp_path: Path) -> None:
    (tmp_path / "mission.yaml").write_text(MISSION)
    vehicle = [
        "--world",
        "open",
        f"--home={PLACE}",
        "--speed",
        "5",
        "--link",
        f"companion=udpout://127.0.0.1:{COMPANION}",
    ]
    links = ["--autopilot", f"udpin://127.0.0.1:{COMPANION}", "--station", f"udpout://127.0.0.1:{STATION}"]
    ground = ["--headless", "--mission", "mission.yaml", "--link", f"udpin://127.0.0.1:{STATION}"]
    with (
        program("sitl", *vehicle, "--out", "sitl", folder=tmp_path),
        program("onboard", "copter", *links, "--out", "out", folder=tmp_path) as onboard,
        program("station", *ground, folder=tmp_path) as station,
    ):
        assert station.process.wait(120.0) == 4, "\n".join([station.text, onboard.text])
        assert "times as fast as this computer's" in station.text
        assert "armed, in air" not in station.text
