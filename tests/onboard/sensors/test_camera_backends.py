"""Cameras that no test machine has: what OpenCV is asked for by V4L2, GStreamer and RTSP, and which times are believed."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from gloc3.errors import Gloc3Error
from gloc3_onboard.sensors.camera_sources import camera as video
from gloc3_onboard.sensors.camera_sources.camera import VideoCamera
from gloc3_onboard.sensors.devices import StampedImage
from gloc3_onboard.sensors.registry import parse_source

NOW_S = 50.0


class Capture:
    """A capture of three frames, that takes what it is told but for sizes above its own."""

    def __init__(self, widest: float = 1e4, driver_s: float = 0.0, frame: Any = None) -> None:
        self.widest, self.driver_s = widest, driver_s
        self.frame = np.full((48, 64, 3), 90, np.uint8) if frame is None else frame
        self.requested: dict[int, float] = {}
        self.left, self.is_released = 3, False

    def isOpened(self) -> bool:  # noqa: N802 (OpenCV names it)
        return True

    def set(self, number: int, value: float) -> None:
        self.requested[number] = value

    def get(self, number: int) -> float:
        if number == cv2.CAP_PROP_POS_MSEC:
            return self.driver_s * 1e3
        return min(self.requested.get(number, 0.0), self.widest)

    def read(self) -> tuple[bool, Any]:
        self.left -= 1
        return self.left >= 0, self.frame

    def release(self) -> None:
        self.is_released = True


class OpenCv:
    """OpenCV, but for how it captures; with GStreamer, as Debian's is."""

    def __init__(self, capture: Capture) -> None:
        self.capture = capture
        self.opened: tuple[Any, ...] = ()
        self.videoio_registry = SimpleNamespace(getBackends=lambda: [cv2.CAP_GSTREAMER])

    def VideoCapture(self, *how: Any) -> Capture:  # noqa: N802
        self.opened = how
        return self.capture

    def getBuildInformation(self) -> str:  # noqa: N802
        return "    GStreamer:                   YES (1.22.0)\n"

    def __getattr__(self, name: str) -> Any:
        return getattr(cv2, name)


def frames(monkeypatch: pytest.MonkeyPatch, url: str, capture: Capture) -> tuple[OpenCv, list[StampedImage | None]]:
    """Opens a camera, and takes all that it shows."""
    library = OpenCv(capture)
    monkeypatch.setattr(video, "load_opencv", lambda: library)
    with VideoCamera("ground", parse_source("ground_camera", url), Path(), lambda: NOW_S).connect() as shown:
        found = list(shown)
    assert capture.is_released
    return library, found


def test_a_v4l2_camera_is_set_up_as_its_url_says(monkeypatch: pytest.MonkeyPatch) -> None:
    url = "v4l2:///dev/null?width=640&height=480&rate_hz=15&exposure_s=0.005&gain=12&format=MJPG"
    library, found = frames(monkeypatch, url, Capture())
    assert library.opened == ("/dev/null", cv2.CAP_V4L2)
    assert library.capture.requested == {
        cv2.CAP_PROP_FOURCC: cv2.VideoWriter.fourcc(*"MJPG"),
        cv2.CAP_PROP_FRAME_WIDTH: 640.0,
        cv2.CAP_PROP_FRAME_HEIGHT: 480.0,
        cv2.CAP_PROP_FPS: 15.0,
        cv2.CAP_PROP_AUTO_EXPOSURE: 1.0,
        cv2.CAP_PROP_EXPOSURE: pytest.approx(50.0),
        cv2.CAP_PROP_GAIN: 12.0,
    }
    assert [(each.image.camera, each.image.width, each.image.data[0]) for each in found if each] == [
        ("ground", 64, 90)
    ] * 3


def test_a_size_that_the_camera_does_not_take_is_an_error_with_the_one_that_it_gives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with pytest.raises(Gloc3Error, match="it gives 320 x 240 pixels, not the width 640"):
        frames(monkeypatch, "v4l2:///dev/null?width=640&height=240", Capture(widest=320.0))


@pytest.mark.parametrize(
    ("driver_s", "told_s"), [(NOW_S - 0.02, NOW_S - 0.03), (0.0, NOW_S - 0.01), (NOW_S + 5.0, NOW_S - 0.01)]
)
def test_the_drivers_time_is_taken_where_it_goes_by_our_clock(
    monkeypatch: pytest.MonkeyPatch, driver_s: float, told_s: float
) -> None:
    _, found = frames(monkeypatch, "v4l2:///dev/null?delay_s=0.01", Capture(driver_s=driver_s))
    assert [each.t_s for each in found if each] == pytest.approx([told_s] * 3)


@pytest.mark.parametrize(
    "frame",
    [np.full((48, 64), 90 << 8, np.uint16), np.full((48, 64, 1), 90, np.uint8), np.full((48, 64), 90, np.uint8)],
)
def test_grey_frames_of_8_and_16_bits_are_taken_too(monkeypatch: pytest.MonkeyPatch, frame: Any) -> None:
    _, found = frames(monkeypatch, "v4l2:///dev/null", Capture(frame=frame))
    assert [set(each.image.data) for each in found if each] == [{90}] * 3


@pytest.mark.parametrize(
    ("url", "opened"),
    [
        ("gst://v4l2src device=/dev/video0 ! appsink", ("v4l2src device=/dev/video0 ! appsink", cv2.CAP_GSTREAMER)),
        (
            "rtsp://192.168.1.20:554/stream",
            (
                "rtsp://192.168.1.20:554/stream",
                cv2.CAP_FFMPEG,
                [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 3000, cv2.CAP_PROP_READ_TIMEOUT_MSEC, 3000],
            ),
        ),
    ],
)
def test_pipelines_and_streams_are_opened_by_their_backend_and_stamped_on_arrival(
    monkeypatch: pytest.MonkeyPatch, url: str, opened: tuple[Any, ...]
) -> None:
    library, found = frames(monkeypatch, url, Capture(driver_s=NOW_S - 0.02))
    assert library.opened == opened
    assert [each.t_s for each in found if each] == [NOW_S] * 3
