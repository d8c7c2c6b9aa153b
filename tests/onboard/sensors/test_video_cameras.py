"""Cameras by VideoCapture, in wall time: files through the same class as hardware; loss, re-opening, and clear refusals."""

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.onboard.scripted_sources import ScriptedSource, picture

from gloc3.clock import VirtualLoop
from gloc3.errors import Gloc3Error
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors import threaded
from gloc3_onboard.sensors.camera_sources.camera import VideoCamera
from gloc3_onboard.sensors.camera_sources.stereo import PairedCameras, SideBySide, half
from gloc3_onboard.sensors.devices import StampedImage
from gloc3_onboard.sensors.pictures import pixels_for_people
from gloc3_onboard.sensors.registry import SourceHost, make_sources, parse_source
from gloc3_onboard.sensors.source_url import device_problem
from gloc3_onboard.sensors.threaded import ThreadedSource

WITHIN_S = 20.0
COLOURS = (40, 90, 140, 190)


def video(path: Path, frames: int = 12, width: int = 64) -> Path:
    """A video in colour, 20 a second; the left half as bright as COLOURS says, one after the other, the right less."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20.0, (width, 48), True)
    for number in range(frames):
        pixels = np.full((48, width, 3), COLOURS[number % 4], np.uint8)
        pixels[:, width // 2 :] = 20
        writer.write(pixels)
    writer.release()
    return path


def camera(folder: Path, url: str) -> VideoCamera:
    return VideoCamera("ground", parse_source("ground_camera", url), folder, time.monotonic)


def until(is_so: Callable[[], bool]) -> None:
    end_s = time.monotonic() + WITHIN_S
    while not is_so():
        assert time.monotonic() < end_s
        time.sleep(0.005)


@contextmanager
def collected(device: VideoCamera) -> Iterator[list[StampedImage]]:
    """Every frame of a camera while it is open."""
    frames: list[StampedImage] = []

    def keep() -> None:
        frame = device.frame()
        assert frame is not None
        frames.append(frame)

    unwatch = device.on_new_data(keep)
    device.open()
    try:
        yield frames
    finally:
        device.close()
        unwatch()


@pytest.mark.sockets
def test_a_video_is_played_at_its_pace_in_grey_and_falls_silent_at_its_end(tmp_path: Path) -> None:
    device = camera(tmp_path, f"video://{video(tmp_path / 'flight.avi').name}")
    begin_s = time.monotonic()
    with collected(device) as frames:
        until(lambda: len(frames) == 12)
        time.sleep(0.15)
    assert len(frames) == 12
    gaps = np.diff([frame.t_s for frame in frames])
    assert gaps == pytest.approx(0.05, abs=1e-6)
    assert frames[0].t_s >= begin_s
    image = frames[5].image
    assert (image.camera, image.width, image.height, len(image.data)) == ("ground", 64, 48, 64 * 48)
    assert image.data[0] == pytest.approx(COLOURS[1], abs=4)


@pytest.mark.sockets
def test_pictures_in_a_folder_are_played_at_the_rate_that_is_asked_for(tmp_path: Path) -> None:
    for number in range(4):
        cv2.imwrite(str(tmp_path / f"{number:03d}.png"), np.full((48, 64), COLOURS[number], np.uint8))
    with collected(camera(tmp_path, "video://%03d.png?rate_hz=100")) as frames:
        until(lambda: len(frames) == 4)
    assert [frame.image.data[0] for frame in frames] == list(COLOURS)
    assert np.diff([frame.t_s for frame in frames]) == pytest.approx(0.01, abs=1e-6)


@pytest.mark.sockets
def test_a_picture_keeps_its_colours_beside_the_grey_values(tmp_path: Path) -> None:
    orange = np.full((48, 64, 3), (20, 120, 240), np.uint8)
    cv2.imwrite(str(tmp_path / "000.png"), orange)
    with collected(camera(tmp_path, "video://%03d.png?rate_hz=100")) as frames:
        until(lambda: len(frames) == 1)
    image = frames[0].image
    assert image.bgr == orange.tobytes()
    assert image.data == cv2.cvtColor(orange, cv2.COLOR_BGR2GRAY).tobytes()
    np.testing.assert_array_equal(pixels_for_people(image), orange)
    with collected(camera(tmp_path, "video://%03d.png?rate_hz=100&pixels=grey")) as frames:
        until(lambda: len(frames) == 1)
    assert (frames[0].image.bgr, frames[0].image.data) == (b"", image.data)


def test_both_halves_of_a_picture_keep_their_colours() -> None:
    colours = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    both = Image(camera="both", width=4, height=2, data=bytes(range(8)), bgr=colours.tobytes())
    for side, name in enumerate(("l", "r")):
        one = half(both, side, name)
        assert one.bgr == colours[:, 2 * side : 2 * side + 2].tobytes()
        assert one.data == bytes([0, 1, 4, 5] if side == 0 else [2, 3, 6, 7])


@pytest.mark.sockets
def test_a_side_by_side_camera_is_a_stereo_pair(tmp_path: Path) -> None:
    video(tmp_path / "both.avi", frames=4, width=128)
    device = SideBySide(camera(tmp_path, "video://both.avi"), ("l", "r"))
    device.open()
    until(lambda: device.pair() is not None)
    pair = device.pair()
    device.close()
    assert pair is not None
    assert [(side.camera, side.width, side.height) for side in (pair.left, pair.right)] == [
        ("l", 64, 48),
        ("r", 64, 48),
    ]
    assert pair.left.data[0] > 30
    assert max(pair.right.data[:30]) < 60


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("v4l2:///dev/video99", "/dev/video99 is not there; is it plugged in?"),
        ("v4l2://99", "/dev/video99 is not there"),
        ("v4l2:///dev/null", ""),
        ("gst://videotestsrc ! appsink", "gst-launch-1.0 is not installed, and this OpenCV is built without GStreamer"),
        ("video://nothing.avi", "is not there"),
        ("video://nothing/%05d.png", "is not there"),
        ("video://text.avi", "is no video"),
    ],
)
@pytest.mark.sockets
def test_a_camera_that_cannot_be_opened_says_what_to_do(tmp_path: Path, url: str, told: str) -> None:
    (tmp_path / "text.avi").write_text("no video")
    device = camera(tmp_path, url)
    with pytest.raises(Gloc3Error) as found:
        device.open()
    assert str(found.value).startswith("ground: ")
    assert told in str(found.value)


def test_a_device_file_without_rights_names_the_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert device_problem(Path("/dev/null"), "video") == ""
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert "sudo usermod -aG video $USER" in device_problem(Path("/dev/null"), "video")
    assert "is not a device" in device_problem(tmp_path, "video")


# --- loss and return ---


class Flaky(ThreadedSource[int]):
    """A device that a test plugs in and out."""

    def __init__(self) -> None:
        super().__init__("flaky", time.monotonic)
        self.is_there = True
        self.opened = self.closed = self.value = 0
        self.end: Exception = OSError("it was torn out")

    @contextmanager
    def connect(self) -> Iterator[Iterator[int | None]]:
        if not self.is_there:
            raise Gloc3Error("flaky is not plugged in; plug it in")
        self.opened += 1
        try:
            yield self._values()
        finally:
            self.closed += 1

    def _values(self) -> Iterator[int | None]:
        while self.is_there:
            time.sleep(0.002)
            self.value += 1
            yield self.value
        raise self.end


@pytest.mark.sockets
def test_a_lost_device_is_opened_anew_by_itself_and_given_up_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threaded, "AGAIN_S", 0.02)
    monkeypatch.setattr(threaded, "GIVE_UP_S", 0.3)
    device = Flaky()
    device.open()
    until(lambda: (device.latest() or 0) > 3)
    device.is_there = False
    until(lambda: device.closed == 1)
    device.is_there = True
    until(lambda: device.opened == 2)
    before = device.latest() or 0
    until(lambda: (device.latest() or 0) > before)
    device.is_there = False

    def is_given_up() -> bool:
        try:
            device.latest()
        except Gloc3Error as error:
            return "plug it in" in str(error)
        return False

    until(is_given_up)
    with pytest.raises(Gloc3Error, match="plug it in"):
        device.open()
    device.is_there = True
    device.open()
    until(lambda: device.latest() is not None)
    device.close()
    until(lambda: device.closed == device.opened)


@pytest.mark.sockets
def test_any_error_of_a_devices_library_is_a_loss_that_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threaded, "AGAIN_S", 0.02)
    monkeypatch.setattr(threaded, "GIVE_UP_S", 0.0)
    device = Flaky()
    device.end = RuntimeError("Frame didn't arrive within 5000")
    device.open()
    until(lambda: (device.latest() or 0) > 3)
    device.is_there = False
    until(lambda: not device.is_reading)
    with pytest.raises(Gloc3Error, match=r"flaky: RuntimeError: Frame didn't arrive within 5000"):
        device.latest()


# --- pairs ---


def stamped(t_s: float, number: int) -> StampedImage:
    return StampedImage(t_s, picture(number))


def test_frames_of_two_cameras_are_paired_by_their_times() -> None:
    left, right = ScriptedSource(), ScriptedSource()
    pair = PairedCameras(left, right, within_s=0.005)
    pair.open()
    assert left.is_open
    assert right.is_open
    shown: list[tuple[float, Image, Image]] = []
    script = [
        ("l", 1.000),
        ("r", 1.003),
        ("r", 1.033),
        ("l", 1.040),
        ("l", 1.070),
        ("r", 1.068),
        ("r", 1.1),
        ("l", 1.1),
    ]
    for number, (side, t_s) in enumerate(script):
        source = left if side == "l" else right
        source.now_frame = stamped(t_s, number)
        found = pair.pair()
        if found is not None and (not shown or found.t_s != shown[-1][0]):
            shown.append(found)
    assert [found[0] for found in shown] == [1.003, 1.07, 1.1]
    assert shown[1][1].data == picture(4).data
    assert shown[1][2].data == picture(5).data
    pair.close()
    assert not left.is_open
    left.now_frame = right.now_frame = None
    pair.open()
    assert pair.pair() is None, "what was taken before is old"


@pytest.mark.parametrize("is_virtual", [True, False])
@pytest.mark.parametrize("lost", [["left"], ["right"], ["left", "right"]])
def test_a_pair_of_which_one_camera_cannot_be_opened_is_not_open(lost: list[str], is_virtual: bool) -> None:
    cameras = {"left": ScriptedSource(), "right": ScriptedSource()}
    for side in lost:
        cameras[side].lost = f"{side} is unplugged"
    with pytest.raises(Gloc3Error, match=f"{lost[0]} is unplugged"):
        PairedCameras(cameras["left"], cameras["right"], 0.005, is_virtual=is_virtual).open()
    assert not cameras["left"].is_open
    assert not cameras["right"].is_open


def test_both_cameras_of_a_pair_open_at_the_same_time() -> None:
    both = threading.Barrier(2, timeout=WITHIN_S)

    class Slow(ScriptedSource):
        def open(self) -> None:
            both.wait()
            super().open()

    left, right = Slow(), Slow()
    PairedCameras(left, right, 0.005).open()
    assert left.is_open
    assert right.is_open


def test_in_virtual_time_the_cameras_of_a_pair_open_in_order_in_the_loops_thread(tmp_path: Path) -> None:
    opened: list[tuple[str, threading.Thread]] = []

    class Noting(ScriptedSource):
        def __init__(self, name: str) -> None:
            super().__init__()
            self.name = name

        def open(self) -> None:
            opened.append((self.name, threading.current_thread()))

    loop = VirtualLoop()
    urls = {"stereo_camera": "pair://left_camera,right_camera", "left_camera": "none://", "right_camera": "none://"}
    host = SourceHost(loop, tmp_path, lambda boot_s: boot_s)
    pair = make_sources(urls, host)["stereo_camera"]
    pair._left, pair._right = Noting("left"), Noting("right")
    pair.open()
    loop.close()
    assert opened == [("left", threading.current_thread()), ("right", threading.current_thread())]
