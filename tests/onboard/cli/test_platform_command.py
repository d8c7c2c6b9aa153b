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
from gloc3.platform.reader import load_platform
from gloc3_onboard.cli.platform_new import KINDS, Answers, Found, platform_text
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
    ("style", "parameters", "failsafe"),
    [
        ("px4", {"NAV_DLL_ACT": 2.0}, "link_loss: {action: return, after_s: 10}   # NAV_DLL_ACT 2"),
        ("ardupilot", {"BATT_FS_LOW_ACT": 1.0}, "low_battery: {action: land"),
    ],
)
def test_a_file_from_a_connected_autopilot_says_what_that_is_set_to(
    style: str, parameters: dict[str, float], failsafe: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "quad.yaml"
    with vehicle(style, **parameters) as url:
        options = ["platform", "new", "--autopilot", url, "--file", str(file), *ANSWERS]
        assert run(options) == 0, capsys.readouterr().err
        text = capsys.readouterr().err
        assert run([*options, "--camera", "v4l2:///dev/video9"]) == 2
        assert f"{file} already exists" in capsys.readouterr().err
    assert failsafe in file.read_text()
    platform = load_platform(str(file), is_loading_classes=True)
    assert (platform.platform, platform.vehicle.mass_kg, platform.arm, platform.on_stop) == (
        "my_quad",
        2.1,
        True,
        "land",
    )
    assert platform.frames["site"].origin.geo[:2] == pytest.approx((39.5528, 2.6285), abs=1e-3)
    assert "assumed: --speed-m-s 3" in text
    assert "record_images" not in platform.capabilities


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
    assert "no autopilot is heard at udpin://127.0.0.1:" in capsys.readouterr().err
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
    assert "host       main: 19 components" in shown
