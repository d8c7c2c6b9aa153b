"""A build of the real PX4 with its own physics (SIH), and the programs of a user: what its documents do not say."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.commands.programs import Program, program

pytestmark = [pytest.mark.firmware, pytest.mark.sockets, pytest.mark.thorough, pytest.mark.timeout(400)]

INSTANCE = 3
AUTOPILOT = ("--autopilot", f"udpin://127.0.0.1:{14540 + INSTANCE}", "--system-id", str(INSTANCE + 1))
STATION = 14763
PARAMETERS = "param set COM_OBL_RC_ACT 5\n"
"""A vehicle without a transmitter holds when its companion is gone."""
MISSION = """\
mission: a corner
frame: site
on_failure: land
on_link_loss: continue
on_low_battery: return
on_pose_lost: land
on_restart: continue
tasks:
  depart: {actions: {climb: {take_off: {height_m: 3}}}}
  go: {after: [depart], actions: {way: {follow_waypoints: {waypoints_m: [[8, 0, 3], [8, 8, 3]], speed_m_s: 1.5}}}}
  recover: {after: [go], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
"""


class RealPx4:
    """The firmware, a platform file that was made from it, and a mission."""

    def __init__(self, folder: Path, binary: Path) -> None:
        self.folder, self._tools = folder, binary.parent
        (folder / "mission.yaml").write_text(MISSION)

    def shell(self, command: str, *words: str) -> None:
        """Runs one of PX4's own commands."""
        tool = [str(self._tools / f"px4-{command}"), "--instance", str(INSTANCE), *words]
        subprocess.run(tool, check=True, capture_output=True, timeout=20.0)

    def make_platform(self) -> str:
        """`gloc3 platform new`, with leave to arm."""
        with program("platform", "new", "--yes", "--arm", "--name", "heron", *AUTOPILOT, folder=self.folder) as new:
            assert new.end() == 0, new.text
        return (self.folder / "heron.yaml").read_text()

    @contextmanager
    def onboard(self) -> Iterator[Program]:
        """The onboard process, which ends well."""
        station = ("--station", f"udpout://127.0.0.1:{STATION}")
        with program("onboard", "heron.yaml", *AUTOPILOT, *station, "--out", "out", folder=self.folder) as running:
            yield running
            if running.process.poll() is None:
                running.interrupt()
                assert running.end() == 0, running.text

    @contextmanager
    def station(self) -> Iterator[Program]:
        """A station that flies the mission."""
        link = ("--link", f"udpin://127.0.0.1:{STATION}")
        with program("station", "--headless", "--mission", "mission.yaml", *link, folder=self.folder) as running:
            yield running

    def fly(self) -> None:
        """One mission, whole."""
        with self.station() as station:
            assert station.end() == 0, station.text


@pytest.fixture
def px4(tmp_path: Path) -> Iterator[RealPx4]:
    found = shutil.which("px4")
    root = None if found is None else Path(found).resolve().parent.parent / "etc"
    if found is None or root is None or not (root / "init.d-posix" / "rcS").is_file():
        pytest.skip("no px4 of a build tree is on PATH: see docs/firmware.md")
    (tmp_path / "px4-rc.params").write_text(PARAMETERS)
    environment = {
        **os.environ,
        "PATH": os.pathsep.join([str(tmp_path), str(root.parent / "bin"), os.environ["PATH"]]),
        "PX4_SIM_MODEL": "sihsim_quadx",
        "PX4_SIMULATOR": "sihsim",
        "PX4_HOME_LAT": "47.397742",
        "PX4_HOME_LON": "8.545594",
        "PX4_HOME_ALT": "488",
    }
    command = [found, "-d", "-i", str(INSTANCE), "-w", str(tmp_path), str(root)]
    with (tmp_path / "px4.txt").open("wb") as output:
        firmware = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=output, stderr=output)
        try:
            limit_s = time.monotonic() + 60.0
            while "Ready for takeoff" not in (tmp_path / "px4.txt").read_text(errors="replace"):
                assert firmware.poll() is None
                assert time.monotonic() < limit_s
                time.sleep(0.2)
            yield RealPx4(tmp_path, Path(found).resolve())
        finally:
            firmware.kill()
            firmware.wait()


def under_way(station: Program) -> None:
    """Some seconds into the path."""
    station.await_line(lambda line: "action go.way: running" in line)
    time.sleep(4.0)


def test_it_knows_where_it_is_though_px4_says_so_only_on_request(px4: RealPx4) -> None:
    text = px4.make_platform()
    assert "frames:" in text.splitlines()[6], text
    assert "geo: [47.39774" in text
    assert "least_acceptance_m: 1" in text


def test_it_says_why_it_would_not_arm_in_px4_s_own_sentence(px4: RealPx4) -> None:
    px4.make_platform()
    px4.shell("sensor_gps_sim", "stop")
    time.sleep(10.0)
    with program("doctor", "heron.yaml", *AUTOPILOT, folder=px4.folder) as doctor:
        assert doctor.end() == 1
        assert "No valid global position estimate" in doctor.text


def test_a_second_mission_of_a_boot_is_flown_like_the_first(px4: RealPx4) -> None:
    px4.make_platform()
    with px4.onboard():
        px4.fly()
        px4.fly()


def test_a_killed_onboard_process_takes_its_mission_up_again(px4: RealPx4) -> None:
    px4.make_platform()
    with px4.station() as station:
        with px4.onboard() as first:
            under_way(station)
            first.interrupt(signal.SIGKILL)
            first.end()
        time.sleep(3.0)
        with px4.onboard():
            assert station.end() == 0, station.text


def test_a_process_that_stood_still_for_four_seconds_is_no_pilot(px4: RealPx4) -> None:
    px4.make_platform()
    with px4.onboard() as onboard, px4.station() as station:
        under_way(station)
        onboard.interrupt(signal.SIGSTOP)
        time.sleep(4.0)
        onboard.interrupt(signal.SIGCONT)
        assert station.end() == 0, station.text
        assert "this process stalled for" in station.text
        assert "pilot has control" not in station.text


def test_a_pilot_who_lands_ends_the_run_with_its_own_exit_code(px4: RealPx4) -> None:
    px4.make_platform()
    with px4.onboard(), px4.station() as station:
        under_way(station)
        px4.shell("commander", "mode", "auto:land")
        assert station.end() == 3, station.text
        assert "a pilot has landed the vehicle" in station.lines[-1]
