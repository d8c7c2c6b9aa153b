"""Sources of devices are URLs of one form; what is wrong in one is refused with the reason and an example."""

import asyncio
import sys
from pathlib import Path
from types import ModuleType
from unittest.mock import Mock

import pytest

from gloc3.clock import VirtualLoop
from gloc3.component.test_bench import Bench
from gloc3.errors import Misuse, Refused
from gloc3.platform.reader import read_platform
from gloc3_onboard.autopilot.sensors import AutopilotSensors
from gloc3_onboard.sensors import registry, sources
from gloc3_onboard.sensors.camera_sources.camera import camera_name
from gloc3_onboard.sensors.camera_sources.stereo import pair_names
from gloc3_onboard.sensors.registry import (
    SourceHost,
    SourceKind,
    make_sources,
    parse_source,
    sensor_kinds,
    sensor_of,
    source_kinds,
    source_urls,
)
from gloc3_onboard.sensors.replay import LogTime
from gloc3_onboard.sensors.sources.height import ReplayHeight

DEVICE_OF = {
    "stereo_camera": "front_stereo_camera",
    "camera": "ground_camera",
    "depth_camera": "rear_depth_camera",
    "laser": "top_laser",
    "lidar": "lidar",
    "imu": "imu",
    "height": "sonar_height",
    "dvl": "dvl",
    "probe": "co2_probe",
    "estimator": "front_estimator",
}


def host(loop: asyncio.AbstractEventLoop) -> SourceHost:
    return SourceHost(
        loop, Path(), lambda boot_s: boot_s, AutopilotSensors(), ReplayHeight(loop, LogTime(), lambda: ())
    )


@pytest.mark.parametrize("scheme", source_kinds())
def test_the_example_of_every_scheme_is_understood_and_made_for_every_sensor_that_it_brings(scheme: str) -> None:
    row = source_kinds()[scheme]
    loop = VirtualLoop()
    for sensor in row.brings:
        for example in row.example.split(", or "):
            device = DEVICE_OF[sensor]
            url = parse_source(device, example)
            assert url.scheme == scheme
            pair = {"left_camera": "none://", "right_camera": "none://"} if scheme == "pair" else {}
            assert make_sources({device: example.partition("#")[0], **pair}, host(loop))[device] is not None
    loop.close()


@pytest.mark.parametrize(
    ("device", "text", "told"),
    [
        ("ground_camera", "", "write SCHEME://PLACE"),
        ("ground_camera", "/dev/video0", "write SCHEME://PLACE"),
        ("ground_camera", "v4l:///dev/video0", "did you mean 'v4l2'"),
        ("ground_camera", "v4l2://", "names nothing behind"),
        ("ground_camera", "gst://", "names nothing behind"),
        ("ground_camera", "carmen://aces.log", "provides laser, but this is a camera"),
        ("laser", "euroc://V1_01", "provides camera or stereo_camera or imu, but this is a laser"),
        ("ground_camera", "v4l2:///dev/video0?widht=640", "did you mean 'width'"),
        ("ground_camera", "v4l2:///dev/video0?width=wide", "width=wide is not a number"),
        ("ground_camera", "v4l2:///dev/video0?width=640.5", "must be a whole number"),
        ("ground_camera", "v4l2:///dev/video0?pixels=red", "pixels=red must be colour or grey"),
        ("ground_camera", "v4l2:///dev/video0?exposure_s=100", "must be from 1e-06 to 10"),
        ("ground_camera", "v4l2:///dev/video0?gain=nan", "gain=nan must be from"),
        ("ground_camera", "v4l2:///dev/video0#left", "allows nothing after #"),
        ("speaker", "none://", "not a sensor"),
        ("imu", "autopilot://px4", "has no address"),
    ],
)
def test_what_is_no_source_is_refused(device: str, text: str, told: str) -> None:
    with pytest.raises(Refused) as found:
        parse_source(device, text)
    assert told in str(found.value)


@pytest.mark.parametrize(
    ("urls", "told"),
    [
        ({"ground_camera": "tcp://127.0.0.1"}, "write an address as tcp://127.0.0.1:5600"),
        ({"ground_camera": "tcp://127.0.0.1:port"}, "write an address"),
        ({"ground_camera": "tcp://127.0.0.1:70000"}, "write an address"),
        ({"laser": "hokuyo://192.168.0.10"}, "write an address as hokuyo://127"),
        ({"laser": "autopilot://#distance"}, "did you mean 'distance_sensor'"),
        ({"estimator": "ros2://odom?yaw_deg=3"}, "there is no yaw_deg of the device estimator"),
        ({"stereo_camera": "pair://left_camera"}, "name two cameras"),
        ({"stereo_camera": "pair://a_camera,b_camera", "a_camera": "none://"}, "there is no camera 'b_camera'"),
    ],
)
def test_what_cannot_be_made_is_refused(urls: dict[str, str], told: str) -> None:
    loop = VirtualLoop()
    with pytest.raises(Refused) as found:
        make_sources(urls, host(loop))
    assert told in str(found.value)
    loop.close()


def test_a_pipeline_of_gstreamer_is_taken_as_it_is() -> None:
    text = "gst://v4l2src device=/dev/video0 ! video/x-raw,format=GRAY8?odd#odd ! appsink"
    assert parse_source("camera", text).place == text.removeprefix("gst://")


def test_names_tell_what_a_device_senses_and_what_its_pictures_are_called() -> None:
    assert [
        (kind := sensor_of(name)) and kind.name for name in ("stereo_camera", "ground_camera", "laser", "imu", "site")
    ] == [
        "stereo_camera",
        "camera",
        "laser",
        "imu",
        None,
    ]
    assert (camera_name("ground_camera"), camera_name("camera")) == ("ground", "camera")
    assert (pair_names("stereo_camera"), pair_names("tail_stereo_camera")) == (
        ("front_left", "front_right"),
        ("tail_left", "tail_right"),
    )


PLATFORM = """\
platform: tester
vehicle: {type: quadrotor, mass_kg: 1.0}
devices: {laser: "carmen://aces.log", spare_laser: "none://"}
cameras: {ground: {width: 640, height: 480, focal_px: [400, 400], center_px: [320, 240]}, front: "front.yaml#cam0"}
components:
  - {name: laser, class: "gloc3_onboard.components.samplers.laser:LaserSampler", rate_hz: 10, devices: {device: laser}}
"""


def test_a_platform_file_tells_sources_and_a_command_line_goes_before_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    doubts: list[str] = []
    platform = read_platform(PLATFORM, "tester.yaml", warn=lambda finding: doubts.append(str(finding)))
    (doubt,) = doubts
    assert doubt.startswith("tester.yaml:3:39: warning: no component uses a device 'spare_laser'")
    assert source_urls(platform, ["laser", "ground_camera", "site"], [])["laser"] == "carmen://aces.log"
    found = source_urls(platform, ["laser", "ground_camera"], ["laser=carmen://other.log", "ground_camera=tcp://a:1"])
    assert found["laser"] == f"carmen://{tmp_path / 'other.log'}", "relative to where it was typed"
    assert found["ground_camera"] == "tcp://a:1"
    for text, reported in (("laser", "NAME=URL"), ("lidar=none://", "known: laser, spare_laser")):
        with pytest.raises(Refused, match=reported):
            source_urls(platform, ["laser"], [text])


def test_every_kind_of_sensor_plays_a_recording_of_nothing() -> None:
    assert set(sensor_kinds()) == set(DEVICE_OF)
    for name, kind in sensor_kinds().items():
        with Bench() as bench:
            device = make_sources({DEVICE_OF[name]: "none://"}, host(bench.loop))[DEVICE_OF[name]]
            reports: list[str] = []
            device.open()
            device.on_new_data(lambda name=name, reports=reports: reports.append(name))
            bench.run(1.0)
            assert (kind.poll(device), reports) == ((), [])
            device.close()


def test_a_package_brings_a_kind_of_source(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("package")
    made = object()
    module.SOURCES = (SourceKind("sonar", ("height",), "sonar:///dev/ttyS0", lambda request: made),)  # type: ignore[attr-defined]
    point = Mock(load=lambda: module)
    monkeypatch.setattr(registry, "installed_points", lambda group: [point] if group == "gloc3.sensors" else [])
    registry._rows.cache_clear()
    try:
        loop = VirtualLoop()
        assert make_sources({"height": "sonar:///dev/ttyS0"}, host(loop)) == {"height": made}
        loop.close()
        module.SENSORS = (sensor_kinds()["laser"]._replace(),)  # type: ignore[attr-defined]
        registry._rows.cache_clear()
        with pytest.raises(Misuse, match="two modules define a sensor called 'laser'"):
            sensor_kinds()
    finally:
        monkeypatch.undo()
        registry._rows.cache_clear()


NEW_KIND = '''\
"""A sensor of gas, in one file: its device, its replay, its scheme and its row."""

from gloc3.messages.vehicle import HeightAboveGround
from gloc3_onboard.sensors.registry import SensorKind, SourceKind
from gloc3_onboard.sensors.sources.height import ReplayHeight


class Nose:
    """A device."""

    def __init__(self, port: str) -> None:
        self.port = port


SENSORS = (SensorKind("gas", ReplayHeight, lambda log, part, device: ()),)
SOURCES = (SourceKind("nose", ("gas",), "nose:///dev/ttyS0", lambda request: Nose(request.url.place)),)
'''


def test_a_new_kind_of_sensor_is_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "gas.py").write_text(NEW_KIND)
    monkeypatch.setattr(sources, "__path__", [*sources.__path__, str(tmp_path)])
    registry._rows.cache_clear()
    loop = VirtualLoop()
    try:
        kind = sensor_of("bilge_gas")
        assert kind is not None
        assert kind.name == "gas"
        made = make_sources({"bilge_gas": "nose:///dev/ttyS1", "other_gas": "none://"}, host(loop))
        assert made["bilge_gas"].port == "/dev/ttyS1"
        assert isinstance(made["other_gas"], ReplayHeight)
        with pytest.raises(Refused, match="nose:// provides gas, but this is a laser"):
            parse_source("laser", "nose:///dev/ttyS1")
    finally:
        loop.close()
        monkeypatch.undo()
        registry._rows.cache_clear()
        sys.modules.pop(f"{sources.__name__}.gas", None)
