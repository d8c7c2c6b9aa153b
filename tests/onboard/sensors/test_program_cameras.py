"""Cameras that a program reads for us: its frames through a pipe, its end, and its complaints; GStreamer where it is installed.

`rpicam-vid` is on no machine of the tests: a program of our own takes its arguments, and writes what it writes.
"""

import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from gloc3.camera.model import CameraModel
from gloc3.errors import Gloc3Error, Refused
from gloc3.platform.reader import load_platform
from gloc3_onboard.inputs import open_sensors
from gloc3_onboard.sensors.camera_sources.raw_frames import RawFrameReader
from gloc3_onboard.sensors.registry import SourceHost, make_sources, parse_source, place_problem

WITHIN_S = 15.0
LUMA, U, V = 120, 90, 200
FRAME = bytes([LUMA]) * (64 * 48) + bytes([U]) * (32 * 24) + bytes([V]) * (32 * 24)
NEEDS_GSTREAMER = pytest.mark.skipif(shutil.which("gst-launch-1.0") is None, reason="GStreamer is not installed")


def y4m(header: bytes, *frames: bytes) -> bytes:
    return b"YUV4MPEG2 " + header + b"\n" + b"".join(b"FRAME\n" + frame for frame in frames)


# --- the stream ---


def test_frames_come_in_any_pieces_and_say_their_size() -> None:
    reader, stream = (
        RawFrameReader(),
        y4m(b"W4 H2 F30:1 Ip A1:1 C420jpeg XYSCSS=420JPEG", b"abcdefghuuvv"[:12], b"x" * 12),
    )
    found = [frame for byte in stream for frame in reader.receive(bytes([byte]))]
    assert [(frame.width, frame.height, frame.is_grey, frame.data) for frame in found] == [
        (4, 2, False, b"abcdefghuuvv"),
        (4, 2, False, b"x" * 12),
    ]
    assert RawFrameReader().receive(y4m(b"W3 H1 Cmono", b"abc"))[0].data == b"abc"
    assert [frame.data for frame in RawFrameReader((2, 2)).receive(b"abcdefghijklm")] == [b"abcdef", b"ghijkl"]


@pytest.mark.parametrize(
    ("stream", "why"),
    [
        (b"RIFF....\n", "it is no stream of Y4M"),
        (b"x" * 2000, "it is no stream of Y4M"),
        (y4m(b"H2"), "the header has no width and height"),
        (y4m(b"W4 H2 C444"), r"frames of 444 are not read; use 4:2:0 \(I420\)"),
        (y4m(b"W4 H2 C420p10"), "frames of 420p10 are not read"),
        (y4m(b"W5 H2"), "frames of 5 x 2 pixels are not read"),
        (y4m(b"W90000 H90000"), "frames of 90000 x 90000 pixels are not read"),
        (y4m(b"W4 H2", b"x" * 12) + b"FRUME\n", "what follows a frame is none"),
    ],
)
def test_what_is_no_such_stream_is_refused_with_the_reason(stream: bytes, why: str) -> None:
    with pytest.raises(Gloc3Error, match=why):
        RawFrameReader().receive(stream)


# --- programs ---


class Loop:
    """The part of an event loop that such sources use."""

    def time(self) -> float:
        return time.monotonic()


def made(device: str, url: str) -> Any:
    host = SourceHost(Loop(), Path(), lambda boot_s: boot_s)  # type: ignore[arg-type]
    return make_sources({device: url}, host)[device]


@contextmanager
def opened(device: Any) -> Iterator[Any]:
    device.open()
    try:
        yield device
    finally:
        device.close()


def until(is_so: Callable[[], Any]) -> None:
    end_s = time.monotonic() + WITHIN_S
    while not is_so():
        assert time.monotonic() < end_s
        time.sleep(0.005)


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str], Path]:
    """Puts a program on PATH that writes its arguments to a file, and does what a line of Python says."""

    def put(name: str, line: str) -> Path:
        file, notes = tmp_path / name, tmp_path / "arguments"
        script = (
            f"import os, sys, time\nopen({str(notes)!r}, 'w').write(' '.join(sys.argv[1:]))\nout = sys.stdout.buffer\n"
        )
        file.write_text(f"#!{sys.executable}\n{script}{line}\n")
        file.chmod(0o755)
        return notes

    monkeypatch.setenv("PATH", str(tmp_path))
    return put


@pytest.mark.sockets
def test_the_offset_in_time_of_a_calibration_is_applied_to_a_camera_s_stamps(
    program: Callable[[str, str], Path], tmp_path: Path
) -> None:
    program("rpicam-vid", f"while True: out.write({FRAME!r}); out.flush(); time.sleep(0.02)")
    model = CameraModel(width=64, height=48, focal_px=(50.0, 50.0), center_px=(32.0, 24.0), time_shift_s=-0.6)
    urls = {"front_camera": "libcamera://1?width=64&height=48&rate_hz=25&delay_s=0.3"}
    platform = replace(load_platform("pelican_rtk"), cameras={"front": model}, devices=urls)
    host = SourceHost(Loop(), tmp_path, lambda boot_s: boot_s)  # type: ignore[arg-type]
    sensors = open_sensors(platform, list(urls), (), host)
    with opened(sensors.devices["front_camera"]) as camera:
        until(camera.frame)
        age_s = time.monotonic() - camera.frame().t_s
    assert 0.9 <= age_s < 1.5


@pytest.mark.sockets
def test_a_camera_of_libcamera_is_read_by_its_own_program(program: Callable[[str, str], Path]) -> None:
    frames = f"while True: out.write({FRAME!r}); out.flush(); time.sleep(0.02)"
    notes = program("rpicam-vid", frames)
    url = "libcamera://1?width=64&height=48&rate_hz=25&exposure_s=0.002&gain=2.5&delay_s=0.03"
    assert place_problem(parse_source("front_camera", url), Path()) == ""
    with opened(made("front_camera", url)) as camera:
        until(camera.frame)
        frame, now_s = camera.frame(), time.monotonic()
    assert (frame.image.camera, frame.image.width, frame.image.height) == ("front", 64, 48)
    assert 0.03 <= now_s - frame.t_s < 5.0
    bgr = np.frombuffer(frame.image.bgr, np.uint8).reshape(48, 64, 3)
    luma = 1.164 * (LUMA - 16)
    expected = luma + 2.018 * (U - 128), luma - 0.391 * (U - 128) - 0.813 * (V - 128), luma + 1.596 * (V - 128)
    assert bgr[5, 5].tolist() == pytest.approx([max(0.0, min(255.0, each)) for each in expected], abs=2)
    assert (
        notes.read_text() == "--nopreview --timeout 0 --camera 1 --width 64 --height 48 --codec yuv420 --output - "
        "--framerate 25 --shutter 2000 --gain 2.5"
    )
    until(lambda: not camera.is_reading)


@pytest.mark.sockets
def test_a_pipeline_is_run_by_gstreamers_program_and_grey_stays_grey(program: Callable[[str, str], Path]) -> None:
    notes = program(
        "gst-launch-1.0", f"out.write({y4m(b'W64 H48 F30:1 C420jpeg', FRAME)!r}); out.flush(); time.sleep(9)"
    )
    url = "gst://v4l2src device='/dev/a b' ! video/x-raw,format=GRAY8 ! appsink drop=true"
    with opened(made("ground_camera", url)) as camera:
        until(camera.frame)
    assert (camera.frame().image.bgr, set(camera.frame().image.data)) == (b"", {LUMA})
    expected = "-q v4l2src device=/dev/a b ! video/x-raw,format=GRAY8 ! videoconvert ! video/x-raw,format=I420 ! y4menc ! fdsink fd=1"
    assert notes.read_text() == expected


@pytest.mark.sockets
def test_a_program_that_ends_says_why_when_it_is_opened_and_is_started_again_later(
    program: Callable[[str, str], Path],
) -> None:
    program("rpicam-vid", "print('camera 1\\nERROR: *** no cameras available ***\\nbye', file=sys.stderr)")
    with pytest.raises(Gloc3Error, match=r"front: rpicam-vid has ended: ERROR: \*\*\* no cameras available"):
        made("front_camera", "libcamera://0").open()
    program("rpicam-vid", f"out.write({FRAME!r})")
    with opened(made("front_camera", "libcamera://0?width=64&height=48&pixels=grey")) as camera:
        until(camera.frame)
        first = camera.frame()
        until(lambda: camera.frame() is not first)
    assert camera.frame().image.bgr == b""


def test_what_cannot_be_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for url, why in (
        ("libcamera://0?width=100&height=48", "width must be a multiple of 64"),
        ("libcamera:///base/soc/i2c0mux", "rpicam-hello --list-cameras"),
    ):
        with pytest.raises(Refused, match=why):
            made("front_camera", url)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(Gloc3Error, match="rpicam-vid is not installed"):
        made("front_camera", "libcamera://0").open()
    assert "sudo apt install rpicam-apps" in place_problem(parse_source("camera", "libcamera://0"), Path())
    monkeypatch.setattr(shutil, "which", lambda name: name)
    with pytest.raises(Refused, match="No closing quotation"):
        made("front_camera", "gst://v4l2src device='/dev/video0 ! appsink")


@NEEDS_GSTREAMER
@pytest.mark.sockets
def test_gstreamer_itself_delivers_colours_and_says_which_element_is_missing() -> None:
    blue = "gst://videotestsrc pattern=blue is-live=true ! video/x-raw,width=64,height=48,framerate=30/1 ! appsink"
    with opened(made("front_camera", blue)) as camera:
        until(camera.frame)
        frame = camera.frame()
    bgr = np.frombuffer(frame.image.bgr, np.uint8).reshape(48, 64, 3)
    assert bgr[24, 32].tolist() == pytest.approx([255, 0, 0], abs=8)
    with pytest.raises(Gloc3Error, match=r'gst-launch-1.0 has ended: .*no element "nonsense"'):
        made("front_camera", "gst://nonsense ! appsink").open()
