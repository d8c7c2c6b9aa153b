"""The pre-flight lines about sensors that samplers read: alive, calibrated, fitting; and what doctor tells unopened."""

from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.onboard.scripted_sources import HEIGHT, WIDTH, OneModel, ScriptedSource, picture

from gloc3.camera.model import CameraModel
from gloc3.errors import InputError
from gloc3.messages.preflight import Check, Verdict
from gloc3.messages.readiness import ComputerState, SensorCondition
from gloc3.platform.platform import Platform
from gloc3.platform.reader import read_platform
from gloc3_onboard.checks.checklist import checklist
from gloc3_onboard.checks.readings import Readings
from gloc3_onboard.sensors.devices import StampedImage
from gloc3_onboard.sensors.rig import PlatformRig, calibration_problems
from gloc3_onboard.sensors.sensor_watch import SensorWatch, unopened_conditions

TEXT = """\
platform: tester
vehicle: {type: quadrotor, mass_kg: 1.0}
cameras: {ground: "ground.yaml#cam0", tail: "tail.yaml"}
components:
  - {name: laser, class: "gloc3_onboard.components.samplers.laser:LaserSampler", rate_hz: 10, devices: {device: laser}, required: true}
  - {name: ground_camera, class: "gloc3_onboard.components.samplers.camera:CameraSampler", rate_hz: 15, devices: {device: ground_camera}}
"""
CAMCHAIN = """\
cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.1, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [60.0, 60.0, 31.5, 23.5]
  resolution: [64, 48]
"""
PLATFORM = read_platform(TEXT, "tester.yaml")


def lines(*conditions: SensorCondition) -> dict[str, Check]:
    readings = Readings(platform=PLATFORM, now_s=0.0, computer=ComputerState(sensors=list(conditions)))
    return {check.name: check for check in checklist(readings)}


def condition(device: str, **changes: Any) -> SensorCondition:
    alive = SensorCondition(device=device, source="v4l2:///dev/video0", age_s=0.1, is_open=True)
    return msgspec.structs.replace(alive, **changes)


def test_a_sensor_that_is_alive_and_calibrated_is_well() -> None:
    assert lines(condition("laser"))["laser"].verdict is Verdict.OK
    assert "alive" in lines(condition("laser"))["laser"].finding


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"age_s": 3.2}, "no data for 3.2 s"),
        ({"age_s": -1.0}, "no data from"),
        ({"source": "none://"}, "no source is given"),
        ({"problem": "laser: /dev/ttyUSB0 is not there; is it plugged in?"}, "/dev/ttyUSB0 is not there"),
    ],
)
def test_a_sensor_that_is_not_well_is_red_where_it_is_required_and_doubtful_elsewhere(
    changes: dict[str, Any], told: str
) -> None:
    red, doubtful = lines(condition("laser", **changes))["laser"], lines(condition("ground_camera", **changes))
    assert told in red.finding
    assert red.advice
    assert red.verdict is Verdict.RED
    assert doubtful["ground_camera"].verdict in (Verdict.WARNING, Verdict.UNKNOWN)


def test_a_camera_without_a_calibration_is_worth_a_warning() -> None:
    found = lines(condition("ground_camera", uncalibrated=["ground"]))["calibration of ground"]
    assert found.verdict is Verdict.WARNING
    assert "cameras: {ground: FILE}" in found.advice


def test_the_advice_stands_apart_from_the_finding() -> None:
    found = lines(condition("laser", problem="laser: /dev/video0 may not be used; sudo usermod -aG video $USER"))[
        "laser"
    ]
    assert (found.finding, found.advice) == ("/dev/video0 may not be used", "sudo usermod -aG video $USER")


# --- while the process runs ---


def test_the_watch_knows_the_age_of_each_sensor_and_whether_pictures_fit() -> None:
    now_s = 10.0
    source, lost = ScriptedSource(), ScriptedSource()
    lost.lost = "left: unplugged; plug it in"
    urls = {"ground_camera": "v4l2://0", "left_camera": "v4l2://1", "laser": "none://"}
    sources = {"ground_camera": source, "left_camera": lost, "laser": ScriptedSource()}
    watch = SensorWatch(urls, sources, OneModel(), lambda: now_s)

    def found() -> dict[str, SensorCondition]:
        return {one.device: one for one in watch.conditions()}

    assert found()["ground_camera"].age_s == -1.0
    assert found()["left_camera"].problem == "left: unplugged; plug it in"
    source.now_frame = StampedImage(10.0, picture())
    source.bell.ring()
    now_s = 12.5
    assert (found()["ground_camera"].age_s, found()["ground_camera"].problem) == (2.5, "")
    source.now_frame = StampedImage(12.0, picture(1, WIDTH // 2, HEIGHT // 2))
    assert "set the camera to that size" in found()["ground_camera"].problem


# --- calibrations and places ---


def test_the_rig_of_a_platform_reads_its_calibrations_and_tells_all_that_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "ground.yaml").write_text(CAMCHAIN)
    (tmp_path / "tail.yaml").write_text(CAMCHAIN.replace("60.0, 60.0", "1.0, 1.0"))
    with pytest.raises(InputError, match=r"tail\.yaml:5:15: a focal length of 1 pixels"):
        PlatformRig(PLATFORM, tmp_path)
    assert list(calibration_problems(PLATFORM, tmp_path)) == ["tail"]
    (tmp_path / "tail.yaml").write_text(CAMCHAIN)
    rig = PlatformRig(PLATFORM, tmp_path)
    model = rig.model("ground")
    assert model is not None
    assert model.focal_px == (60.0, 60.0)
    assert rig.model("front") is None
    (tmp_path / "tail.yaml").write_text(CAMCHAIN.replace("31.5, 23.5", "1.5, 23.5"))
    assert "far from the middle" in calibration_problems(PLATFORM, tmp_path)["tail"]
    assert "far from the middle" in str(PlatformRig(PLATFORM, tmp_path).warnings[0])


def test_a_model_may_stand_in_the_platform_file_itself(tmp_path: Path) -> None:
    model = CameraModel(width=64, height=48, focal_px=(50.0, 50.0), center_px=(32.0, 24.0))
    platform: Platform = msgspec.structs.replace(PLATFORM, cameras={"ground": model})
    assert PlatformRig(platform, tmp_path).model("ground") is model


@pytest.mark.parametrize(
    ("device", "url", "told"),
    [
        ("ground_camera", "v4l2:///dev/video99", "/dev/video99 is not there; is it plugged in?"),
        ("ground_camera", "video://nothing.avi", "nothing.avi is not there"),
        ("laser", "hokuyo:///dev/ttyACM99", "/dev/ttyACM99 is not there"),
        ("laser", "carmen://ground.yaml", ""),
        ("laser", "hokuyo://192.168.0.10:10940", ""),
        ("laser", "what://", "is not a source"),
    ],
)
def test_what_can_be_told_of_a_source_without_opening_it(tmp_path: Path, device: str, url: str, told: str) -> None:
    (tmp_path / "ground.yaml").write_text(CAMCHAIN)
    (found,) = unopened_conditions({device: url}, tmp_path, lambda camera: False, {})
    assert told in found.problem
    assert bool(found.problem) == bool(told)
    assert not found.is_open


def test_a_calibration_that_cannot_be_used_is_told_of_its_camera(tmp_path: Path) -> None:
    urls = {"ground_camera": "tcp://127.0.0.1:5600"}
    (found,) = unopened_conditions(urls, tmp_path, lambda camera: True, {"ground": "ground.yaml: cannot be read"})
    assert found.problem == "ground.yaml: cannot be read"
    assert found.uncalibrated == []
    assert lines(found)["ground_camera"].verdict is Verdict.WARNING
