"""Recordings of RealSense cameras, made by the library itself from a software device into which a test puts pictures."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pyrealsense2 as rs

WIDTH, HEIGHT = 64, 48
UNIT_M = 0.0005
RATE_HZ = 30
STREAMS = {
    "depth": (rs.stream.depth, 0, rs.format.z16, 2),
    "colour": (rs.stream.color, 0, rs.format.bgr8, 3),
    "left": (rs.stream.infrared, 1, rs.format.y8, 1),
    "right": (rs.stream.infrared, 2, rs.format.y8, 1),
}


def pixels(name: str, number: int) -> "np.ndarray[Any, np.dtype[Any]]":
    """The picture of that number: depths of 1 m and more on the left, none on the right; others of one value."""
    if name == "depth":
        found = np.zeros((HEIGHT, WIDTH), np.uint16)
        found[:, : WIDTH // 2] = 2000 + number
        return found
    if name == "colour":
        return np.full((HEIGHT, WIDTH, 3), (10, 100 + number, 200), np.uint8)
    return np.full((HEIGHT, WIDTH), (50 if name == "left" else 90) + number, np.uint8)


def record(path: Path, *streams: str, count: int = 12, serial: str = "048122070681") -> Path:
    """A recording of these streams, with `count` pictures of each."""
    device = rs.software_device()
    device.register_info(rs.camera_info.name, "Test D435")
    device.register_info(rs.camera_info.serial_number, serial)
    sensors = {name: device.add_sensor(name) for name in streams}
    profiles = {name: sensors[name].add_video_stream(_stream(uid, name), True) for uid, name in enumerate(streams)}
    if "depth" in sensors:
        sensors["depth"].add_read_only_option(rs.option.depth_units, UNIT_M)
    recorder = rs.recorder(str(path), device)
    recorded, queue = recorder.query_sensors(), rs.frame_queue(100)
    for sensor in recorded:
        sensor.open(sensor.get_stream_profiles()[0])
        sensor.start(queue)
    for number in range(count):
        for name in streams:
            sensors[name].on_video_frame(_frame(name, number, profiles[name]))
        time.sleep(1.0 / RATE_HZ)
    for sensor in recorded:
        sensor.stop()
        sensor.close()
    return path


def _stream(uid: int, name: str) -> Any:
    kind, index, form, size = STREAMS[name]
    lens = rs.intrinsics()
    lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy = WIDTH, HEIGHT, 50.0, 50.0, 31.5, 23.5
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fps, stream.bpp, stream.fmt = kind, index, uid, RATE_HZ, size, form
    stream.width, stream.height, stream.intrinsics = WIDTH, HEIGHT, lens
    return stream


def _frame(name: str, number: int, profile: Any) -> Any:
    size = STREAMS[name][3]
    frame = rs.software_video_frame()
    frame.pixels = pixels(name, number).view(np.uint8).ravel()
    frame.stride, frame.bpp = WIDTH * size, size
    frame.timestamp, frame.frame_number = 5000.0 + number * 1000.0 / RATE_HZ, number
    frame.domain = rs.timestamp_domain.hardware_clock
    frame.profile = profile.as_video_stream_profile()
    if name == "depth":
        frame.depth_units = UNIT_M
    return frame
