"""Controls of V4L2 cameras, against the kernel's interface as `videodev2.h` has it; no machine of the tests has a camera."""

import errno
import fcntl
import struct
from pathlib import Path
from typing import Any

import pytest

from gloc3.errors import Gloc3Error, Refused
from gloc3_onboard.sensors.camera_sources.camera import VideoCamera
from gloc3_onboard.sensors.camera_sources.v4l2_controls import parse_controls, set_controls
from gloc3_onboard.sensors.registry import parse_source

INTEGER, BOOLEAN, MENU, BUTTON, CLASS, INTEGER_MENU = 1, 2, 3, 4, 6, 9
DISABLED, READ_ONLY = 1, 4


class Driver:
    """A camera's driver behind `ioctl`: a webcam's controls, of which some are coupled."""

    CONTROLS = (
        # identifier, type, name, least, greatest, flags
        (0x0098_0001, CLASS, b"User Controls", 0, 0, READ_ONLY),
        (0x0098_0900, INTEGER, b"Brightness", -64, 64, 0),
        (0x0098_090C, BOOLEAN, b"White Balance, Automatic", 0, 1, 0),
        (0x0098_0913, INTEGER, b"Gain", 0, 100, 0),
        (0x0098_0918, MENU, b"Power Line Frequency", 0, 2, 0),
        (0x0098_091A, INTEGER, b"White Balance Temperature", 2800, 6500, 0),
        (0x0098_0999, INTEGER, b"Serial", 0, 9, READ_ONLY),
        (0x0098_099A, INTEGER, b"Iris", 0, 9, DISABLED),
        (0x009A_0901, MENU, b"Auto Exposure", 0, 3, 0),
        (0x009A_0902, INTEGER, b"Exposure Time, Absolute", 3, 2047, 0),
        (0x009A_0903, INTEGER_MENU, b"Scene Rate", 0, 1, 0),
    )
    MENUS = {
        (0x0098_0918, 0): b"Disabled", (0x0098_0918, 1): b"50 Hz", (0x0098_0918, 2): b"60 Hz",
        (0x009A_0901, 1): b"Manual Mode", (0x009A_0901, 3): b"Aperture Priority Mode",
        (0x009A_0903, 0): struct.pack("<q", 15), (0x009A_0903, 1): struct.pack("<q", 30),
    }  # fmt: skip

    def __init__(self) -> None:
        self.values = {number: least for number, _, _, least, _, _ in self.CONTROLS}
        self.values[0x009A_0901], self.values[0x0098_090C] = 3, 1
        self.order: list[int] = []

    def ioctl(self, file: int, request: int, data: bytes) -> bytes:
        kind, number, size = request >> 30, request & 0xFF, request >> 16 & 0x3FFF
        assert (kind, request >> 8 & 0xFF, len(data)) == (3, ord("V"), size)
        answer = {36: self._query, 37: self._menu, 27: self._get, 28: self._put}[number](data)
        assert len(answer) == size
        return answer

    def _query(self, data: bytes) -> bytes:
        (wanted,) = struct.unpack_from("=I", data)
        assert wanted & 0x8000_0000
        for number, kind, name, least, greatest, flags in self.CONTROLS:
            if number > wanted & 0x7FFF_FFFF:
                return struct.pack("=II32siiiiI8x", number, kind, name, least, greatest, 1, 0, flags)
        raise OSError(errno.EINVAL, "Invalid argument")

    def _menu(self, data: bytes) -> bytes:
        number, index = struct.unpack_from("=II", data)
        if (number, index) not in self.MENUS:
            raise OSError(errno.EINVAL, "Invalid argument")
        return struct.pack("=II32s4x", number, index, self.MENUS[number, index])

    def _get(self, data: bytes) -> bytes:
        (number,) = struct.unpack_from("=I", data)
        return struct.pack("=Ii", number, self.values[number])

    def _put(self, data: bytes) -> bytes:
        number, value = struct.unpack("=Ii", data)
        if number == 0x009A_0902 and self.values[0x009A_0901] != 1:
            raise OSError(errno.EBUSY, "Device or resource busy")
        self.order.append(number)
        self.values[number] = value if number != 0x0098_0913 else value // 2 * 2  # it has even gains only
        return data


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> Driver:
    found = Driver()
    monkeypatch.setattr(fcntl, "ioctl", found.ioctl)
    return found


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    path = tmp_path / "video0"
    path.touch()
    return path


def put(camera: Path, text: str) -> None:
    set_controls("front", camera, parse_controls("front", text))


def test_controls_are_set_by_name_in_their_order_with_numbers_or_words_of_a_menu(driver: Driver, camera: Path) -> None:
    put(camera, "auto_exposure:manual_mode,exposure_time_absolute:120,white_balance_automatic:0,gain:40,brightness:-3")
    assert driver.order == [0x009A_0901, 0x009A_0902, 0x0098_090C, 0x0098_0913, 0x0098_0900]
    assert [driver.values[number] for number in driver.order] == [1, 120, 0, 40, -3]
    put(camera, "auto_exposure:3,power_line_frequency:50_hz,scene_rate:30")
    assert [driver.values[number] for number in (0x009A_0901, 0x0098_0918, 0x009A_0903)] == [3, 1, 1]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (
            "gian:40",
            r"has no control 'gian'; did you mean 'gain'.*It has: brightness \(-64 to 64\); white_balance_automatic",
        ),
        ("serial:1", r"has no control 'serial'.*auto_exposure \(1 manual_mode or 3 aperture_priority_mode\)"),
        ("iris:1", "has no control 'iris'"),
        ("gain:101", "gain:101 must be 0 to 100"),
        ("gain:much", "gain:much must be 0 to 100"),
        ("auto_exposure:2", "must be 1 manual_mode or 3 aperture_priority_mode"),
        ("auto_exposure:off", "must be 1 manual_mode or 3 aperture_priority_mode"),
        ("gain:41", "the device has set 40 in place of 41"),
        ("exposure_time_absolute:9", "Device or resource busy; an automatic mode may control it; set that first"),
    ],
)
def test_what_a_device_does_not_have_or_take_is_refused_with_what_it_has(
    text: str, why: str, driver: Driver, camera: Path
) -> None:
    with pytest.raises(Gloc3Error, match=why):
        put(camera, text)


def test_a_device_that_is_gone_or_has_no_controls_is_said_to_be_so(
    camera: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(Gloc3Error, match="No such file"):
        put(camera.with_name("video9"), "gain:1")
    with pytest.raises(Gloc3Error, match=r"has no control 'gain'.*It has: none"):
        put(camera, "gain:1")  # a file is no camera: the kernel itself refuses to answer


@pytest.mark.parametrize("text", ["gain", "gain=4", ":4", "gain:", "gain:4,,hue:2"])
def test_controls_that_are_not_written_as_such_are_refused_before_anything_starts(text: str) -> None:
    with pytest.raises(Refused, match="must be NAME:VALUE,…, such as gain:40"):
        VideoCamera("front", parse_source("camera", f"v4l2://0?controls={text}"), Path(), lambda: 0.0)


def test_a_camera_sets_its_controls_after_it_is_opened(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.onboard.sensors.test_camera_backends import Capture, OpenCv

    from gloc3_onboard.sensors.camera_sources import camera as video

    done: list[Any] = []
    monkeypatch.setattr(video, "load_opencv", lambda: OpenCv(Capture()))
    monkeypatch.setattr(video, "device_problem", lambda path, group: "")
    monkeypatch.setattr(video, "set_controls", lambda *given: done.append(given))
    device = VideoCamera("front", parse_source("camera", "v4l2:///dev/video0?controls=gain:40"), Path(), lambda: 0.0)
    with device.connect():
        assert done == [("front", Path("/dev/video0"), [("gain", "40")])]
