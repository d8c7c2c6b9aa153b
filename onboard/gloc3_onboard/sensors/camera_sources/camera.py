"""Cameras: by OpenCV's VideoCapture: V4L2 devices, GStreamer pipelines, RTSP streams, video files at their pace, and logs."""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

from gloc3.camera.opencv import load_opencv
from gloc3.errors import Finding, Gloc3Error, InputError, nearest
from gloc3.log.reader import LogReader
from gloc3.messages.vehicle import Image, ImageRecorded
from gloc3_onboard.sensors import devices
from gloc3_onboard.sensors.camera_sources.stereo import STEREO, SideBySide, pair_names
from gloc3_onboard.sensors.camera_sources.v4l2_controls import parse_controls, set_controls
from gloc3_onboard.sensors.devices import StampedImage
from gloc3_onboard.sensors.pictures import load_picture
from gloc3_onboard.sensors.registry import SensorKind, SourceKind, SourceRequest
from gloc3_onboard.sensors.replay import Recorded, Replay, topic_records
from gloc3_onboard.sensors.source_url import (
    DELAY,
    PIXELS,
    RATE,
    VIDEO_GROUP,
    Number,
    Options,
    SourceUrl,
    device_problem,
)
from gloc3_onboard.sensors.threaded import ThreadedSource

CAMERA: Final = "camera"
EYES: Final = (CAMERA, STEREO)
"""What a source of pictures can be the source of."""
RECORDED: Final = "image_recorded"
"""Topic of pictures saved to disk."""
WIDTH: Final = Number(16, 16_384, True)
V4L2: Final[Options] = {
    "width": WIDTH,
    "height": WIDTH,
    **RATE,
    "exposure_s": Number(1e-6, 10.0),
    "gain": Number(0.0, 1e4),
    "format": None,
    "controls": None,
    **DELAY,
    **PIXELS,
}
MANUAL_EXPOSURE: Final = 1.0
"""V4L2_EXPOSURE_MANUAL."""
EXPOSURE_UNIT_S: Final = 1e-4
"""V4L2_CID_EXPOSURE_ABSOLUTE counts in 100 µs."""
BELIEVED_S: Final = 1.0
"""A driver's stamp that is further from the present is of another clock."""
NETWORK_TIMEOUT_MS: Final = 3000.0
FILE_HZ: Final = 15.0
"""Frame rate of picture folders, Hz."""


class VideoCamera(ThreadedSource[StampedImage]):
    """A camera that VideoCapture can open.

    Frames are converted to grey, and keep their colours unless `pixels=grey`. Their time is the driver's if on the monotonic clock (V4L2), else that of arrival less
    `delay_s`. A file plays at its own pace from its opening on.

    Args:
        name: name of the camera.
        url: `v4l2`, `gst`, `rtsp` or `video`.
        folder: base of relative file names.
        now_s: our time, monotonic.

    Raises:
        Refused: the URL's controls are not written as such.
    """

    def __init__(self, name: str, url: SourceUrl, folder: Path, now_s: Callable[[], float]) -> None:
        super().__init__(name, now_s)
        self._url, self._folder = url, folder
        self._delay_s = url.number("delay_s", 0.0)
        self._controls = parse_controls(name, url.options.get("controls", ""))

    def frame(self) -> StampedImage | None:
        """The latest frame; None before the first."""
        return self.latest()

    @contextmanager
    def connect(self) -> Iterator[Iterator[StampedImage | None]]:
        """Opens the capture."""
        cv2 = load_opencv()
        logging = cv2.utils.logging
        logging.setLogLevel(logging.LOG_LEVEL_SILENT)  # what goes wrong is told in our own words
        capture = self._capture(cv2)
        try:
            if not capture.isOpened():
                raise Gloc3Error(f"{self.name}: {self._closed_reason()}")
            _set_up(cv2, capture, self._url.options, self.name)
            if self._controls:
                set_controls(self.name, self._url.device_file or Path(self._url.place), self._controls)
            yield self._frames(cv2, capture)
        finally:
            capture.release()

    def _capture(self, cv2: Any) -> Any:
        place = self._url.place
        if self._url.scheme == "gst":
            if cv2.CAP_GSTREAMER not in cv2.videoio_registry.getBackends() or not _is_built_with_gstreamer(cv2):
                raise Gloc3Error(
                    f"{self.name}: gst-launch-1.0 is not installed, and this OpenCV is built without GStreamer; Debian: sudo apt "
                    "install gstreamer1.0-tools gstreamer1.0-plugins-base gstreamer1.0-plugins-good"
                )
            return cv2.VideoCapture(place, cv2.CAP_GSTREAMER)
        if self._url.scheme == "v4l2":
            path = self._url.device_file or Path(place)
            problem = device_problem(path, VIDEO_GROUP)
            if problem:
                raise Gloc3Error(f"{self.name}: {problem}")
            return cv2.VideoCapture(str(path), cv2.CAP_V4L2)
        if self._url.scheme == "rtsp":
            timeouts = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, NETWORK_TIMEOUT_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC]
            return cv2.VideoCapture(f"rtsp://{place}", cv2.CAP_FFMPEG, [*map(int, timeouts), int(NETWORK_TIMEOUT_MS)])
        path = self._folder / place
        if not path.parent.is_dir() or ("%" not in path.name and not path.is_file()):
            raise Gloc3Error(f"{self.name}: {path} is not there")
        return cv2.VideoCapture(str(path))

    def _closed_reason(self) -> str:
        reasons: Mapping[str, str] = {
            "v4l2": f"{self._url.place} cannot be opened; does another program use it? fuser {self._url.place}",
            "gst": "the pipeline does not start; try it with gst-launch-1.0, and let it end in appsink",
            "rtsp": f"rtsp://{self._url.place} does not answer; check address, cable and power",
        }
        return reasons.get(self._url.scheme, f"{self._url.place} is no video, or no pictures in order")

    def _frames(self, cv2: Any, capture: Any) -> Iterator[StampedImage | None]:
        begin_s, count = self.now_s(), 0
        is_file = self._url.scheme == "video"
        rate_hz = self._url.number("rate_hz", capture.get(cv2.CAP_PROP_FPS) if "%" not in self._url.place else FILE_HZ)
        pause = threading.Event()
        while True:
            is_read, pixels = capture.read()
            if not is_read or pixels is None:
                break
            t_s = begin_s + count / (rate_hz if rate_hz > 0.0 else FILE_HZ) if is_file else self._stamp_s(cv2, capture)
            count += 1
            if is_file:
                pause.wait(max(0.0, t_s - self.now_s()))
            yield StampedImage(t_s, image_of(cv2, pixels, self.name, keeps_colours=not self._url.is_grey))
        while is_file:  # it has ended; the camera falls silent, and is not lost
            pause.wait(0.1)
            yield None

    def _stamp_s(self, cv2: Any, capture: Any) -> float:
        now_s = self.now_s()
        if self._url.scheme == "v4l2":
            driver_s = float(capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3
            if 0.0 <= now_s - driver_s < BELIEVED_S:
                return driver_s - self._delay_s
        return now_s - self._delay_s


def _is_built_with_gstreamer(cv2: Any) -> bool:
    return any("GStreamer" in line and "YES" in line for line in cv2.getBuildInformation().splitlines())


def _set_up(cv2: Any, capture: Any, options: Mapping[str, str], name: str) -> None:
    """Applies the options; an unsupported size is an error, since the calibration depends on it."""
    if "format" in options:
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*options["format"].ljust(4)[:4]))
    for option, number in (("width", cv2.CAP_PROP_FRAME_WIDTH), ("height", cv2.CAP_PROP_FRAME_HEIGHT)):
        if option in options:
            capture.set(number, float(options[option]))
    for option, number in (("width", cv2.CAP_PROP_FRAME_WIDTH), ("height", cv2.CAP_PROP_FRAME_HEIGHT)):
        if option in options and round(capture.get(number)) != round(float(options[option])):
            given = f"{capture.get(cv2.CAP_PROP_FRAME_WIDTH):.0f} x {capture.get(cv2.CAP_PROP_FRAME_HEIGHT):.0f}"
            raise Gloc3Error(
                f"{name}: it gives {given} pixels, not the {option} {options[option]}; v4l2-ctl lists sizes"
            )
    if "rate_hz" in options:
        capture.set(cv2.CAP_PROP_FPS, float(options["rate_hz"]))
    if "exposure_s" in options:
        capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL_EXPOSURE)
        capture.set(cv2.CAP_PROP_EXPOSURE, float(options["exposure_s"]) / EXPOSURE_UNIT_S)
    if "gain" in options:
        capture.set(cv2.CAP_PROP_GAIN, float(options["gain"]))


def image_of(cv2: Any, pixels: Any, name: str, *, keeps_colours: bool) -> Image:
    """A picture in 8-bit grey for processors, with the colours beside it where there are any and they are wanted."""
    if pixels.dtype != "uint8":
        pixels = (pixels >> 8).astype("uint8")
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[:, :, 0]
    is_grey = pixels.ndim == 2
    grey = pixels if is_grey else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    height, width = grey.shape
    bgr = b"" if is_grey or not keeps_colours else pixels.tobytes()
    return Image(camera=name, width=width, height=height, data=grey.tobytes(), bgr=bgr)


class ReplayCamera(Replay[Image]):
    """A camera of a log."""

    _frame: StampedImage | None = None

    def play(self, t_s: float, item: Image) -> None:
        """Keeps a frame."""
        self._frame = StampedImage(t_s, item)

    def clear(self) -> None:
        """Keeps nothing."""
        self._frame = None

    def frame(self) -> StampedImage | None:
        """The latest frame; None before the first."""
        self.check()
        return self._frame


def camera_name(device: str) -> str:
    """What the pictures of a camera are called: `ground_camera` takes those of *ground*."""
    return device.removesuffix(CAMERA).rstrip("_") or CAMERA


def recorded_pictures(path: Path, camera: str) -> Sequence[Recorded[Image]]:
    """Pictures of a flight from the folder beside its log, with their capture times.

    Args:
        path: the log.
        camera: name of the camera.

    Raises:
        InputError: the file is not a log, or names no such pictures.
    """
    folder = path.parent / path.stem.replace("log", "images", 1)
    with LogReader(path) as reader:
        reader.require_ours("data of sensors")
        entries = [
            entry.envelope for entry in reader.entries(RECORDED) if isinstance(entry.envelope.payload, ImageRecorded)
        ]
    found = [
        Recorded(envelope.t_s, partial(load_picture, folder / envelope.payload.file, camera))
        for envelope in entries
        if envelope.payload.camera == camera
    ]
    if not found:
        known = sorted({envelope.payload.camera for envelope in entries})
        message = f"no pictures of {camera!r} were recorded"
        raise InputError([Finding(file=str(path), message=message, hint=nearest(camera, known))])
    return found


def _logged(log: Path, part: str, device: str) -> Sequence[Recorded[Image]]:
    name = camera_name(device)
    return recorded_pictures(log, name) if part == RECORDED else topic_records(log, part or f"camera/{name}", Image)


def _poll(device: devices.Camera) -> Sequence[Image]:
    frame = device.frame()
    return () if frame is None else (frame.image,)


def _make(request: SourceRequest) -> VideoCamera | SideBySide:
    camera = VideoCamera(camera_name(request.device), request.url, request.host.folder, request.now_s)
    return SideBySide(camera, pair_names(request.device)) if request.sensor.name == STEREO else camera


SENSORS: Final = (SensorKind(CAMERA, ReplayCamera, _logged, _poll, lambda device: (camera_name(device),)),)
SOURCES: Final = (
    SourceKind("v4l2", EYES, "v4l2:///dev/video0?width=640&height=480&rate_hz=15", _make, V4L2, group=VIDEO_GROUP),
    SourceKind("rtsp", EYES, "rtsp://192.168.1.20:554/stream", _make, {**DELAY, **PIXELS}),
    SourceKind(
        "video",
        EYES,
        "video://flight.mp4, or video://pictures/%05d.png?rate_hz=15",
        _make,
        {**RATE, **PIXELS},
        is_file=True,
    ),
)
