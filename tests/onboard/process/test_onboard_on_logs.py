"""The onboard process in wall time with its sensors on logs: pictures, scans and samples come, and the list tells of each."""

import asyncio
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from tests.onboard.scripted_sources import euroc

from gloc3.messages.envelope import Envelope
from gloc3.platform.reader import load_platform
from gloc3_onboard.process.options import ProcessOptions
from gloc3_onboard.process.process import DEVICES, OnboardProcess

pytestmark = pytest.mark.sockets

PLATFORM = """\
platform: tester
vehicle: {type: quadrotor, mass_kg: 1.0}
devices: {stereo_camera: "euroc://data", imu: "euroc://data#imu0", laser: "hokuyo:///dev/nothing"}
cameras: {front_left: "front.yaml#cam0"}
components:
  - {name: stereo, class: "gloc3_onboard.components.samplers.stereo_camera:StereoCameraSampler", rate_hz: 20, devices: {device: stereo_camera, rig: rig}, ports: {left: camera/front_left, right: camera/front_right}}
  - {name: laser, class: "gloc3_onboard.components.samplers.laser:LaserSampler", rate_hz: 10, devices: {device: laser}}
  - {name: imu, class: "gloc3_onboard.components.samplers.imu:ImuSampler", rate_hz: 200, devices: {device: imu}}
  - {name: computer, class: "gloc3_onboard.components.samplers.computer:ComputerSampler", rate_hz: 10, devices: {device: computer}}
"""
CALIBRATION = """\
cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.1, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [60.0, 60.0, 31.5, 23.5]
  resolution: [64, 48]
"""


def keep(received: dict[str, Envelope[Any]], envelope: Envelope[Any]) -> None:
    received[envelope.topic] = envelope


async def until(received: dict[str, Envelope[Any]], *topics: str) -> None:
    async with asyncio.timeout(20.0):
        while any(f"tester/{topic}" not in received for topic in topics):
            await asyncio.sleep(0.02)


async def test_sensors_on_logs_bring_data_and_one_that_is_not_there_is_told_with_what_to_do(tmp_path: Path) -> None:
    euroc(tmp_path / "data", frames=100)
    (tmp_path / "tester.yaml").write_text(PLATFORM)
    (tmp_path / "front.yaml").write_text(CALIBRATION)
    (tmp_path / "walk.log").write_text("FLASER 4 1.0 2.0 3.0 4.0 0 0 0 0 0 0 100.0 host 0.0\n")
    file = str(tmp_path / "tester.yaml")
    platform = load_platform(file, is_loading_classes=True, devices=DEVICES)
    address = "udpin://127.0.0.1:0"
    for override, laser in ((), "faulty"), ((f"laser=carmen://{tmp_path / 'walk.log'}",), "working"):
        options = ProcessOptions(
            platform=file, autopilot=address, stations=(), devices=override, out=tmp_path / laser, is_quiet=True
        )
        process = OnboardProcess(options, platform, asyncio.get_running_loop())
        received: dict[str, Envelope[Any]] = {}
        process.exchange.subscribe("**", partial(keep, received))
        await process.open()
        try:
            await until(received, "camera/front_left", "camera/front_right", "imu", "computer")
            if laser == "working":
                await until(received, "laser")
            await asyncio.sleep(0.3)
        finally:
            await process.close()
        assert received["tester/camera/front_left"].payload.is_valid
        assert received["tester/imu"].payload.is_valid
        sensors = {one.device: one for one in received["tester/computer"].payload.sensors}
        assert sensors["stereo_camera"].uncalibrated == ["front_right"]
        assert 0.0 <= sensors["imu"].age_s < 1.0
        if laser == "faulty":
            assert "/dev/nothing is not there; is it plugged in?" in sensors["laser"].problem
        else:
            assert sensors["laser"].problem == ""
            assert received["tester/laser"].payload.is_valid
