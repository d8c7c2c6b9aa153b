"""The real PX4 as a standard VTOL and the real ArduPlane as a QuadPlane, with physics of their own, led by plans."""

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest
from tests.commands.programs import program
from tests.onboard.real_vehicle import COMPASS, INERTIAL

pytestmark = [pytest.mark.firmware, pytest.mark.sockets, pytest.mark.thorough, pytest.mark.timeout(600)]

INSTANCE = 7
STATION = 14767
HOME = (47.397742, 8.545594, 488.0)
PLATFORM = """\
platform: heron
extends: vtol
vehicle: {{type: vtol, mass_kg: 3}}
frames:
  site: {{origin: {{geo: [47.397742, 8.545594, 488.0]}}, x_axis_bearing_deg: 0}}
limits: {{survey_speed_m_s: {cruise}, speed_min_m_s: {least}, speed_m_s: {most}, transition_m: {transition}}}
power: {{hover_w: 20, per_m_s_w: 1, climb_w_per_m_s: 4, avionics_w: 1, battery_wh: 400, reserve: 0.1, wings_w: 12}}
components:
  - {{name: ways, settings: {{cruise_m_s: {cruise}, transition_m: {transition}}}}}
"""
MISSION = """\
mission: on wings
frame: site
on_failure: land
on_link_loss: continue
on_low_battery: return
on_pose_lost: land
tasks:
  away: {actions: {off: {take_off: {height_m: 40}}}}
  hop: {after: [away], actions: {near: {follow_waypoints: {waypoints_m: [[20, 0, 40]], by: rotors}}}}
  field: {after: [hop], actions: {lines: {follow_waypoints: {waypoints_m: [[500, 0, 50], [500, -400, 50]], by: wings}}}}
  back: {after: [field], actions: {home: {return_home: {}}, down: {land: {}, after: [home]}}}
"""
PX4 = {
    "MIS_TKO_LAND_REQ": 0, "NAV_DLL_ACT": 0, "COM_LOW_BAT_ACT": 3, "BAT_CRIT_THR": 0.1, "COM_QC_ACT": -1, "COM_RC_IN_MODE": 4,
    "COM_OBL_RC_ACT": 5, "RTL_TYPE": 0,
}  # fmt: skip
ARDUPILOT = {
    "Q_ENABLE": 1, "Q_MAV_TYPE": 22, "Q_GUIDED_MODE": 1, "Q_RTL_MODE": 1, "Q_TRANS_FAIL": 15, "Q_TRANS_FAIL_ACT": -1,
    "FS_GCS_ENABL": 0, "FENCE_TYPE": 4, "ARSPD_USE": 1, "AIRSPEED_MIN": 13, "AIRSPEED_MAX": 35, "AIRSPEED_CRUISE": 25,
    "ROLL_LIMIT_DEG": 65, "PTCH_LIM_MAX_DEG": 30, "PTCH_LIM_MIN_DEG": -30, "NAVL1_PERIOD": 14, "Q_ASSIST_SPEED": 18,
    "RLL_RATE_P": 0.141, "RLL_RATE_I": 0.2125, "RLL_RATE_FF": 0.5527, "PTCH_RATE_P": 0.31, "PTCH_RATE_I": 0.2125,
    "PTCH_RATE_FF": 1.407, "KFF_RDDRMIX": 0.5, "Q_A_RAT_RLL_P": 0.108, "Q_A_RAT_RLL_I": 0.108, "Q_A_RAT_RLL_D": 0.001,
    "Q_A_RAT_PIT_P": 0.103, "Q_A_RAT_PIT_I": 0.103, "Q_A_RAT_PIT_D": 0.001, "Q_A_RAT_YAW_P": 0.2, "Q_A_RAT_YAW_I": 0.02,
    "Q_A_ANG_RLL_P": 6, "Q_A_ANG_PIT_P": 6, "SCHED_LOOP_RATE": 300, "BATT_FS_LOW_ACT": 1, "BATT_LOW_MAH": 330,
}  # fmt: skip
"""The preset's, and the gains of the simulated QuadPlane."""


def words(parameters: Mapping[str, float], form: str) -> str:
    return "".join(form.format(name, value) for name, value in parameters.items())


@contextmanager
def running(command: list[str], folder: Path, environment: dict[str, str]) -> Iterator[None]:
    with (folder / "firmware.log").open("wb") as log:
        firmware = subprocess.Popen(
            command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT
        )
        try:
            yield
        finally:
            firmware.kill()
            firmware.wait()


@contextmanager
def px4(folder: Path) -> Iterator[list[str]]:
    found = shutil.which("px4")
    root = None if found is None else Path(found).resolve().parent.parent / "etc"
    if found is None or root is None or not (root / "init.d-posix" / "rcS").is_file():
        pytest.skip("no px4 of a build tree is on PATH: see docs/firmware.md")
    (folder / "px4-rc.params").write_text(words(PX4, "param set {} {}\n"))
    environment = {
        **os.environ,
        "PATH": os.pathsep.join([str(folder), str(root.parent / "bin"), os.environ["PATH"]]),
        "PX4_SIM_MODEL": "sihsim_standard_vtol",
        "PX4_SIMULATOR": "sihsim",
        **{f"PX4_HOME_{name}": str(value) for name, value in zip(("LAT", "LON", "ALT"), HOME, strict=True)},
    }
    with running([found, "-i", str(INSTANCE), "-d", str(root)], folder, environment):
        yield ["--autopilot", f"udpin://127.0.0.1:{14540 + INSTANCE}", "--system-id", str(INSTANCE + 1)]


@contextmanager
def ardupilot(folder: Path) -> Iterator[list[str]]:
    found = shutil.which("arduplane")
    if found is None:
        pytest.skip("arduplane is not on PATH: see docs/firmware.md")
    (folder / "defaults.parm").write_text(words(ARDUPILOT, "{} {}\n") + COMPASS + INERTIAL)
    place = ",".join(map(str, (*HOME, 0)))
    command = [found, "--model", "quadplane", "--home", place, f"-I{INSTANCE}", "--defaults", "defaults.parm"]
    with running(command, folder, dict(os.environ)):
        yield ["--autopilot", f"tcpout://127.0.0.1:{5760 + 10 * INSTANCE}"]


@pytest.mark.parametrize(
    ("firmware", "speeds"),
    [
        (px4, {"cruise": 10.0, "least": 7.0, "most": 12.0, "transition": 80.0}),
        (ardupilot, {"cruise": 22.0, "least": 15.0, "most": 30.0, "transition": 150.0}),
    ],
)
def test_it_takes_off_on_rotors_flies_its_lines_on_wings_and_lands_on_rotors_at_home(
    firmware: Callable[[Path], AbstractContextManager[list[str]]], speeds: dict[str, float], tmp_path: Path
) -> None:
    (tmp_path / "heron.yaml").write_text(PLATFORM.format(**speeds))
    (tmp_path / "mission.yaml").write_text(MISSION)
    with firmware(tmp_path) as autopilot:
        station = ["--station", f"udpout://127.0.0.1:{STATION}", "--out", "out"]
        with program("onboard", "heron.yaml", *autopilot, *station, folder=tmp_path) as onboard:
            link = f"udpin://127.0.0.1:{STATION}"
            with program(
                "station", "--headless", "--mission", "mission.yaml", "--link", link, folder=tmp_path
            ) as flown:
                assert flown.end(400.0) == 0, flown.text
            onboard.interrupt()
            onboard.end()
    assert ", on wings" in flown.text
    last = [line for line in flown.text.splitlines() if " back.down" in line and "; 47." in line][-1]
    latitude, longitude = (float(number) for number in last.split("; ")[1].split()[:2])
    assert abs(latitude - HOME[0]) * 111_320.0 < 10.0
    assert abs(longitude - HOME[1]) * 75_400.0 < 10.0
