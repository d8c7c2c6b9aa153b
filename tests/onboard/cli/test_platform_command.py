"""`gloc3 platform`: a file from a connected autopilot, everything that is wrong in one, and what is in one."""

import asyncio
import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gloc3.cli.program import run
from gloc3.mavlink.transport.endpoints import open_endpoint
from gloc3.messages.readiness import AutopilotSetup
from gloc3.messages.vehicle import Style, VehicleClass
from gloc3.platform.bases import platform_files
from gloc3.platform.platform import Platform
from gloc3.platform.reader import load_platform
from gloc3_onboard.autopilot.inspection import AT_ONCE
from gloc3_onboard.autopilot.setpoints import NEAR_M
from gloc3_onboard.checks.tables import table_of
from gloc3_onboard.cli.platform_new import KINDS, Answers, Found, platform_text
from gloc3_onboard.cli.platform_readings import SOURCES, read_limits
from gloc3_onboard.cli.platform_report import report_on
from gloc3_sitl.vehicles.simulator import LinkKind, Simulator, SimulatorSettings
from gloc3_sitl.world import World

ANSWERS = ["--name", "my_quad", "--mass-kg", "2.1", "--arm", "--on-stop", "land", "--yes"]


@contextmanager
def vehicle(style: str, **parameters: float) -> Iterator[str]:
    """A simulated vehicle that has stood for a while, in a thread of its own; gives where it is heard."""
    ready, end = threading.Event(), threading.Event()
    url: list[str] = []

    async def stand() -> None:
        loop = asyncio.get_running_loop()
        simulator = Simulator(World.load("hold"), SimulatorSettings(style=style, parameters=parameters))
        receivers: list[Callable[[bytes], None]] = []
        endpoint = await open_endpoint("tcpin://127.0.0.1:0", loop, lambda data: receivers[0](data))  # noqa: PLW0108
        receivers.append(simulator.attach(endpoint.send, LinkKind.COMPANION, is_datagram=endpoint.is_datagram))
        simulator.advance(4.0)
        simulator.start(loop, 4.0)
        url.append(f"tcpout://127.0.0.1:{endpoint.local_port}")
        ready.set()
        while not end.is_set():
            await asyncio.sleep(0.05)
        simulator.stop()
        await endpoint.close()

    thread = threading.Thread(target=asyncio.run, args=(stand(),))
    thread.start()
    try:
        assert ready.wait(60.0)
        yield url[0]
    finally:
        end.set()
        thread.join()


@pytest.mark.sockets
@pytest.mark.parametrize(
    ("style", "parameters", "lines", "told"),
    [
        (
            "px4",
            {"NAV_DLL_ACT": 2.0, "MPC_XY_CRUISE": 6.0, "MPC_ACC_HOR": 2.4, "GF_MAX_VER_DIST": 40.0},
            [
                "  link_loss: {action: return, after_s: 10}   # NAV_DLL_ACT 2",
                "vehicle: {type: quadrotor, mass_kg: 2.1} # type: MAV_TYPE 2",
                "  speed_m_s: 6                  # MPC_XY_CRUISE 6",
                "  climb_m_s: 3                  # MPC_Z_V_AUTO_UP 3",
                "  landing_m_s: 0.7              # in the last part of a landing; MPC_LAND_SPEED 0.7",
                "  acceleration_m_s2: 2.4        # MPC_ACC_HOR 2.4",
                "  height_max_m: 40              # GF_MAX_VER_DIST 40",
                "  - {name: hold, settings: {braking_m_s2: 1.68}}",
                "  - {name: teleoperate, settings: {acceleration_m_s2: 1.44}}",
                "battery_wh: 69.4, reserve: 0.2}   # battery_wh: BAT1_CAPACITY 6250, BAT1_N_CELLS 3, 3.7 V a cell",
            ],
            [
                "read: --type quadrotor (MAV_TYPE 2)",
                "read: --speed-m-s 6 (MPC_XY_CRUISE 6)",
                "read: --height-max-m 40 (GF_MAX_VER_DIST 40)",
                "read: --battery-wh 69.4 (BAT1_CAPACITY 6250",
            ],
        ),
        (
            "ardupilot",
            {"BATT_FS_LOW_ACT": 1.0, "WP_SPD": 4.0, "WP_ACC": 4.0, "FENCE_ENABLE": 1.0, "BATT_CAPACITY": 3300.0},
            [
                "  low_battery: {action: land, at: 0.189394}   # BATT_FS_LOW_ACT 1",
                "  speed_m_s: 4                  # WP_SPD 4",
                "  climb_m_s: 2.5                # WP_SPD_UP 2.5",
                "  landing_m_s: 0.5              # in the last part of a landing; LAND_SPD_MS 0.5",
                "  acceleration_m_s2: 3          # WP_ACC 4, limited to 3",
                "  height_max_m: 100             # FENCE_ALT_MAX 100",
                "  fence_margin_m: 1             # that waypoints and legs keep from a mission's fence; assumed",
                "  - {name: hold, settings: {braking_m_s2: 2.1}}",
                "  - {name: teleoperate, settings: {acceleration_m_s2: 1.8}}",
                "battery_wh: 36.6, reserve: 0.2}   # battery_wh: BATT_CAPACITY 3300 (ArduPilot's default: check it), 3 cells",
            ],
            ["read: --speed-m-s 4 (WP_SPD 4)", "read: --height-max-m 100 (FENCE_ALT_MAX 100)"],
        ),
        (
            "ardupilot",
            {"FENCE_ENABLE": 0.0},
            ["  height_max_m: 30", "  speed_m_s: 5                  # WP_SPD 5"],
            ["assumed: --height-max-m 30"],
        ),
    ],
)
def test_a_file_from_a_connected_autopilot_says_what_that_is_set_to(
    style: str,
    parameters: dict[str, float],
    lines: list[str],
    told: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = tmp_path / "quad.yaml"
    with vehicle(style, **parameters) as url:
        options = ["platform", "new", "--autopilot", url, "--file", str(file), *ANSWERS]
        assert run(options) == 0, capsys.readouterr().err
        text = capsys.readouterr().err
        assert run([*options, "--camera", "v4l2:///dev/video9"]) == 2
        assert f"{file} already exists" in capsys.readouterr().err
        slow = tmp_path / "slow.yaml"
        assert run(["platform", "new", "--autopilot", url, "--file", str(slow), *ANSWERS, "--speed-m-s", "1"]) == 0
    written = file.read_text()
    assert "\ngloc3: 1\nplatform: " in written, "the version of its format"
    assert [line for line in lines if line not in written] == [], written
    assert [line for line in told if line not in text] == [], text
    assert "assumed: --camera nothing" in text
    platform = load_platform(str(file), is_loading_classes=True)
    assert (platform.platform, platform.vehicle.mass_kg, platform.arm, platform.on_stop) == (
        "my_quad",
        2.1,
        True,
        "land",
    )
    assert platform.frames["site"].origin.geo[:2] == pytest.approx((39.5528, 2.6285), abs=1e-3)
    assert "record_images" not in platform.capabilities
    rows = {row.name: row.settings for row in platform.components}
    assert rows["setting_off"] == {"arm": True, "tolerance_m": 0.5}, "plain satellites know no better how high it is"
    assert rows["waypoints"]["least_acceptance_m"] == 1.0
    assert rows["waypoints"]["at_rest_m_s"] == 0.4
    assert "  speed_m_s: 1\n" in slow.read_text(), "an option wins"
    assert ", limited to 1\n" in slow.read_text(), "it climbs no faster than it flies"


def _setup(style: Style, vehicle_class: VehicleClass, **parameters: float) -> AutopilotSetup:
    return AutopilotSetup(style=style, vehicle=vehicle_class, is_complete=True, parameters=parameters)


@pytest.mark.parametrize(
    ("setup", "battery_v", "found"),
    [
        (
            _setup(
                Style.ARDUPILOT,
                VehicleClass.COPTER,
                WPNAV_SPEED=750.0,
                WPNAV_ACCEL=250.0,
                WPNAV_SPEED_UP=150.0,
                LAND_SPEED=40.0,
            ),
            0.0,
            {
                "speed_m_s": (7.5, "WPNAV_SPEED 750"),
                "climb_m_s": (1.5, "WPNAV_SPEED_UP 150"),
                "landing_m_s": (0.4, "LAND_SPEED 40"),
                "acceleration_m_s2": (2.5, "WPNAV_ACCEL 250"),
            },
        ),
        (
            _setup(Style.PX4, VehicleClass.COPTER, MPC_XY_CRUISE=5.0, MPC_XY_VEL_MAX=3.0, MPC_ACC_HOR=0.01),
            0.0,
            {"speed_m_s": (3.0, "MPC_XY_VEL_MAX 3"), "acceleration_m_s2": (0.2, "MPC_ACC_HOR 0.01, limited to 0.2")},
        ),
        (
            _setup(
                Style.PX4,
                VehicleClass.COPTER,
                MPC_XY_CRUISE=float("nan"),
                MPC_XY_VEL_MAX=12.0,
                BAT1_CAPACITY=-1.0,
                BAT1_N_CELLS=4.0,
            ),
            15.0,
            {},
        ),
        (_setup(Style.ARDUPILOT, VehicleClass.BOAT, CRUISE_SPEED=1.5), 0.0, {"speed_m_s": (1.5, "CRUISE_SPEED 1.5")}),
        (
            _setup(Style.ARDUPILOT, VehicleClass.SUB, WPNAV_SPEED=500.0, BATT_CAPACITY=18000.0),
            15.2,
            {"battery_wh": (266.4, "BATT_CAPACITY 18000, 4 cells estimated from 15.2 V, 3.7 V a cell")},
        ),
        (
            _setup(Style.ARDUPILOT, VehicleClass.PLANE, FENCE_ENABLE=1.0, FENCE_TYPE=4.0, FENCE_ALT_MAX=80.0),
            0.0,
            {},
        ),
        (
            _setup(Style.PX4, VehicleClass.PLANE, FW_AIRSPD_TRIM=15.0, FW_AIRSPD_MIN=10.0),
            0.0,
            {"survey_speed_m_s": (15.0, "FW_AIRSPD_TRIM 15"), "speed_min_m_s": (10.0, "FW_AIRSPD_MIN 10")},
        ),
    ],
)
def test_limits_are_read_by_the_names_and_units_of_each_version(
    setup: AutopilotSetup, battery_v: float, found: dict[str, tuple[float, str]]
) -> None:
    read = read_limits(setup, battery_v)
    assert {name: one.source for name, one in read.items()} == {name: source for name, (_, source) in found.items()}
    assert {name: one.value for name, one in read.items()} == pytest.approx(
        {name: one[0] for name, one in found.items()}
    )


def test_an_autopilot_that_is_silent_about_unknown_names_still_answers_the_others_meanwhile() -> None:
    """Each of these names blocks a place of those that are read at once, until it counts as unanswered."""
    for style, vehicle_class in SOURCES:
        other_versions = sum(len(names) - 1 for names in SOURCES[style, vehicle_class].values())
        assert other_versions + len(table_of(style, vehicle_class).arming_checks) // 2 < AT_ONCE


def test_a_planes_speeds_and_heights_agree_with_each_other_and_with_its_parameters(tmp_path: Path) -> None:
    parameters = {"AIRSPEED_CRUISE": 28.0, "AIRSPEED_MIN": 16.0, "FENCE_ENABLE": 1.0, "FENCE_TYPE": 1.0}
    found = Found(_setup(Style.ARDUPILOT, VehicleClass.PLANE, **parameters, FENCE_ALT_MAX=30.0), None)
    assert found.readings["speed_m_s"] == (28.0, "AIRSPEED_CRUISE 28")
    for speed_m_s, height_max_m in ((28.0, 30.0), (14.0, 15.0)):
        file = tmp_path / f"{speed_m_s:g}.yaml"
        answers = Answers("it", "aircraft", 3.0, speed_m_s, height_max_m, 150.0, False, "hold", "")
        file.write_text(platform_text(found, answers))
        limits = load_platform(str(file)).limits
        assert (limits.survey_speed_m_s, limits.speed_min_m_s) == (speed_m_s, min(16.0, speed_m_s))
        assert (limits.survey_height_m, limits.height_max_m) == (height_max_m, height_max_m)
        assert limits.height_min_m < height_max_m


def test_a_hexarotor_is_known_by_its_heartbeat() -> None:
    setup = _setup(Style.PX4, VehicleClass.COPTER)
    assert [Found(setup, None, mav_type=number).type for number in (13, 14)] == ["hexarotor", ""]


@pytest.mark.parametrize("vehicle_class", KINDS)
@pytest.mark.parametrize("camera", ["", "v4l2:///dev/video9"])
def test_the_file_of_every_class_of_vehicle_can_be_used(
    vehicle_class: VehicleClass, camera: str, tmp_path: Path
) -> None:
    kind = KINDS[vehicle_class]
    found = Found(AutopilotSetup(style=Style.ARDUPILOT, vehicle=vehicle_class, is_complete=True), None)
    file = tmp_path / "it.yaml"
    file.write_text(
        platform_text(
            found,
            Answers("it", kind.types[-1], kind.mass_kg, kind.speed_m_s, kind.heights_m[1], 50.0, False, "hold", camera),
        )
    )
    report = report_on(str(file))
    assert report.is_ok, report.findings
    assert report.platform is not None
    assert ("record_images" in report.platform.capabilities) is bool(camera)
    if vehicle_class in (VehicleClass.ROVER, VehicleClass.BOAT):
        assert least_acceptance_m(report.platform) > NEAR_M
    if vehicle_class is VehicleClass.BOAT:  # in waves it is never at rest otherwise
        driver = next(row for row in report.platform.components if row.name == "autopilot_driver")
        assert driver.settings["at_rest_over_s"] == 6


def test_a_rover_that_stops_beside_a_place_has_come_to_it() -> None:
    """Led by velocities it goes no nearer to a place at rest: a return home would never end."""
    assert least_acceptance_m(load_platform("rover")) > NEAR_M


def least_acceptance_m(platform: Platform) -> float:
    (row,) = [row for row in platform.components if row.name == "waypoints"]
    return float(row.settings.get("least_acceptance_m", 0.0))


def test_what_no_mission_can_be_checked_against_stands_in_the_file_as_a_comment() -> None:
    multirotor = next(one for one in KINDS if "quadrotor" in KINDS[one].types)
    setup = AutopilotSetup(style=Style.PX4, vehicle=multirotor, is_complete=True, parameters={"NAV_DLL_ACT": 5.0})
    text = platform_text(Found(setup, None), Answers("it", "quadrotor", 2.0, 3.0, 30.0, 50.0, False, "hold", ""))
    assert "# link_loss: it would terminate, which no mission can be checked against" in text


@pytest.mark.sockets
def test_where_no_autopilot_is_heard_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    assert run(["platform", "new", "--autopilot", f"udpin://127.0.0.1:{port}", "--wait", "0.2", "--yes"]) == 1
    assert "no autopilot responds at udpin://127.0.0.1:" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


WRONG = """\
platform: wrong
vehicle: {type: quadrotor, mass_kg: 1.0}
devices: {ground_camera: "v4l3:///dev/video0"}
cameras: {ground: nowhere.yaml}
components:
  - {name: ground_camera, class: "gloc3_onboard.components.samplers.camera:CameraSampler", rate_hz: 15, devices: {device: ground_camera, rig: rig}, ports: {image: camera/ground}}
"""


def test_everything_that_is_wrong_is_told_at_once_with_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "wrong.yaml"
    file.write_text(WRONG)
    assert run(["platform", "check", str(file), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert not report["is_ok"]
    found = [(one["line"], one["column"], one["message"]) for one in report["findings"] if not one["is_warning"]]
    assert (3, 26, "ground_camera: 'v4l3:///dev/video0' is not a source") in found
    assert any("nowhere.yaml" in one["file"] + one["message"] for one in report["findings"])
    assert run(["platform", "check", str(file)]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == f"{file} cannot be used: 2 errors"
    assert run(["platform", "check", "copter"]) == 0
    capsys.readouterr()
    assert run(["platform", "check", "coptre"]) == 2
    assert "coptre: no such platform (did you mean 'copter'?)" in capsys.readouterr().err


def test_a_platform_is_shown_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["platform", "show", "copter"]) == 0
    shown = capsys.readouterr().out
    assert "copter: quadrotor, 1.5 kg, missions may arm it" in shown
    assert "host       main: 20 components" in shown


@pytest.mark.parametrize("name", sorted(platform_files()))
def test_every_installed_platform_can_be_used_with_its_settings(name: str) -> None:
    assert run(["platform", "check", name]) == 0
