"""The offset in time of a calibration, on the stamps of live cameras whatever their source; once, and not on logs'."""

import asyncio
import time
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from gloc3.camera.frame_stream import CameraFrame, encode
from gloc3.camera.model import CameraModel
from gloc3.clock import passed
from gloc3.messages.perception import DepthImage
from gloc3.messages.vehicle import Image
from gloc3.platform.reader import load_platform
from gloc3_onboard.inputs import open_sensors
from gloc3_onboard.sensors.camera_sources.camera import VideoCamera
from gloc3_onboard.sensors.camera_sources.shared import SharedDevice
from gloc3_onboard.sensors.devices import StampedDepth, StampedImage, StampedPair
from gloc3_onboard.sensors.registry import SourceHost

SHIFTS_S = {"front": -0.25, "front_left": -0.5, "front_right": -0.25, "depth": 0.125, "left": -0.5, "right": -0.5}
IMAGE = Image(camera="any", width=4, height=2, data=bytes(8))
DEPTH = DepthImage(camera="depth", width=1, height=1, data=bytes(2), scale_m=0.001, range_min_m=0.1, range_max_m=9.0)
LATEST = {
    "camera": StampedImage(5.0, IMAGE),
    "stereo_camera": StampedPair(6.0, IMAGE, IMAGE),
    "depth_camera": StampedDepth(7.0, DEPTH),
}


class Loop:
    """The part of an event loop that such sources use."""

    def time(self) -> float:
        return time.monotonic()


def made(**urls: str) -> Any:
    """The devices of a vehicle whose cameras are calibrated."""
    lens = CameraModel(width=4, height=2, focal_px=(5.0, 5.0), center_px=(2.0, 1.0))
    cameras = {name: replace(lens, time_shift_s=shift_s) for name, shift_s in SHIFTS_S.items()}
    platform = replace(load_platform("pelican_rtk"), cameras=cameras, devices=urls)
    host = SourceHost(Loop(), Path(), lambda boot_s: boot_s)  # type: ignore[arg-type]
    return open_sensors(platform, list(urls), (), host).devices


@pytest.mark.parametrize("scheme", ["oak", "realsense"])
def test_each_sensor_of_a_shared_camera_has_its_own(scheme: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SharedDevice, "latest", lambda _: LATEST)
    devices = made(**dict.fromkeys(("front_camera", "stereo_camera", "depth_camera"), f"{scheme}://any"))
    assert devices["front_camera"].frame() == StampedImage(4.75, IMAGE)
    assert devices["stereo_camera"].pair() == StampedPair(5.5, IMAGE, IMAGE)
    assert devices["depth_camera"].depth() == StampedDepth(7.125, DEPTH)
    monkeypatch.setattr(SharedDevice, "latest", lambda _: None)
    assert devices["depth_camera"].depth() is None


def test_the_cameras_of_a_pair_are_shifted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(VideoCamera, "latest", lambda _: StampedImage(5.0, IMAGE))
    devices = made(
        stereo_camera="pair://left_camera,right_camera", left_camera="rtsp://a/left", right_camera="rtsp://a/right"
    )
    assert devices["stereo_camera"].pair().t_s == 4.5


def test_files_hold_shifted_times(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(VideoCamera, "latest", lambda _: StampedImage(5.0, IMAGE))
    assert made(front_camera="video://flight.mp4")["front_camera"].frame().t_s == 5.0


@pytest.mark.sockets
async def test_a_simulated_camera_over_tcp_is_shifted() -> None:
    async def serve(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(encode(CameraFrame(5_000_000, "front", 4, 2, bytes(8))))
        await writer.drain()
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    camera = made(front_camera=f"tcp://127.0.0.1:{server.sockets[0].getsockname()[1]}")["front_camera"]
    camera.open()
    try:
        async with asyncio.timeout(10.0):
            while camera.frame() is None:
                await passed(0.01)
    finally:
        camera.close()
        server.close()
    assert camera.frame().t_s == 4.75
