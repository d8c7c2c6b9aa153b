"""Video of a simulated camera, end to end: announced by the camera component, read by OpenCV from the announced URL."""

import socket
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.onboard.onboard_scene import vehicle
from tests.onboard.qgc_sequences import Station

from gloc3_sitl.demo.demo import free_ports

pytest.importorskip("av")

pytestmark = [pytest.mark.sockets, pytest.mark.flight]

CAMERA = 100
HAS_STREAM, RTSP, RUNNING = 256, 0, 1


def test_the_simulated_camera_announces_its_video_and_opencv_reads_it(tmp_path: Path) -> None:
    sensors, video = free_ports(2, socket.SOCK_STREAM)
    options = ("--device", f"ground_camera=tcp://127.0.0.1:{sensors}", "--video", f"127.0.0.1:{video}")
    with (
        vehicle(tmp_path, *options, simulator=("--sensors", str(sensors))) as scene,
        closing(Station(scene.port)) as qgc,
    ):
        about = qgc.request(CAMERA, 259, "CAMERA_INFORMATION")
        assert about.flags & HAS_STREAM
        stream = qgc.request(CAMERA, 269, "VIDEO_STREAM_INFORMATION")
        assert (stream.type, stream.flags, stream.resolution_h, stream.resolution_v) == (RTSP, RUNNING, 640, 480)
        assert stream.uri == f"rtsp://127.0.0.1:{video}/ground"
        capture = cv2.VideoCapture(stream.uri, cv2.CAP_FFMPEG)
        try:
            frames = [capture.read()[1] for _ in range(3)]
        finally:
            capture.release()
    assert [frame.shape for frame in frames] == [(480, 640, 3)] * 3
    assert np.ptp(frames[-1]) > 50, "it shows something"
