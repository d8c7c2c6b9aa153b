"""Cameras read by another program, which writes their frames to a pipe: GStreamer, and libcamera's `rpicam-vid`."""

import itertools
import os
import re
import select
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Final

from gloc3.camera.opencv import load_opencv
from gloc3.errors import Gloc3Error, Refused
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.camera_sources.camera import EYES, VideoCamera, camera_name, image_of
from gloc3_onboard.sensors.camera_sources.raw_frames import RawFrame, RawFrameReader
from gloc3_onboard.sensors.camera_sources.stereo import STEREO, SideBySide, pair_names
from gloc3_onboard.sensors.devices import StampedImage
from gloc3_onboard.sensors.registry import SourceKind, SourceRequest
from gloc3_onboard.sensors.source_url import DELAY, GREY, PIXELS, RATE, VIDEO_GROUP, Number, SourceUrl
from gloc3_onboard.sensors.threaded import ThreadedSource

GSTREAMER: Final = "gst-launch-1.0"
RPICAM: Final = ("rpicam-vid", "libcamera-vid")
"""The program, by its present and its former name."""
STRIDE: Final = 64
"""Rows of raw frames are padded to a multiple of so many pixels."""
SIZE: Final = (640, 480)
RATE_HZ: Final = 30.0
ENDS_WITHIN_S: Final = 2.0
WAIT_S: Final = 0.25
START_PIECES: Final = 12
"""So many times `WAIT_S` is waited for the first bytes; a component's start has 5 s."""


class ProgramCamera(ThreadedSource[StampedImage]):
    """A camera whose frames a program writes to its standard output.

    Args:
        name: name of the camera.
        command: the program with its arguments.
        size: width and height of raw YUV420 frames; None for a Y4M stream, which says it.
        url: of the camera, with its options.
        now_s: our time, monotonic.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        size: tuple[int, int] | None,
        url: SourceUrl,
        now_s: Callable[[], float],
    ) -> None:
        super().__init__(name, now_s)
        self._command, self._size = command, size
        self._keeps_colours, self._delay_s = not url.is_grey, url.number("delay_s", 0.0)

    def frame(self) -> StampedImage | None:
        """The latest frame; None before the first."""
        return self.latest()

    @contextmanager
    def connect(self) -> Iterator[Iterator[StampedImage | None]]:
        """Starts the program, which ends with the reading."""
        program = self._command[0]
        if shutil.which(program) is None:
            raise Gloc3Error(f"{self.name}: {program} is not installed")
        with tempfile.TemporaryFile() as complaints:
            process = subprocess.Popen(
                self._command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=complaints, bufsize=0
            )
            assert process.stdout is not None
            try:
                pieces = _pieces(process.stdout.fileno())
                yield self._frames(self._first(pieces, complaints), pieces, complaints)
            finally:
                process.terminate()
                try:
                    process.wait(ENDS_WITHIN_S)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
                process.stdout.close()

    def _first(self, pieces: Iterator[bytes | None], complaints: IO[bytes]) -> bytes:
        """The first bytes; none if it takes long. A program that cannot start ends at once."""
        for _, piece in zip(range(START_PIECES), pieces, strict=False):
            if piece == b"":
                raise self._ended(complaints)
            if piece is not None:
                return piece
        return b""

    def _frames(
        self, first: bytes, pieces: Iterator[bytes | None], complaints: IO[bytes]
    ) -> Iterator[StampedImage | None]:
        reader = RawFrameReader(self._size)
        for piece in itertools.chain([first] if first else [], pieces):
            if piece == b"":
                raise self._ended(complaints)
            try:
                frames = reader.receive(piece or b"")
            except Gloc3Error as error:
                raise Gloc3Error(f"{self.name}: {self._command[0]}: {error}") from error
            yield StampedImage(self.now_s() - self._delay_s, self._image(frames[-1])) if frames else None

    def _image(self, frame: RawFrame) -> Image:
        if frame.is_grey or not self._keeps_colours:
            data = frame.data[: frame.width * frame.height]
            return Image(camera=self.name, width=frame.width, height=frame.height, data=data)
        import numpy as np

        cv2: Any = load_opencv()
        planes = np.frombuffer(frame.data, np.uint8).reshape(frame.height * 3 // 2, frame.width)
        return image_of(cv2, cv2.cvtColor(planes, cv2.COLOR_YUV2BGR_I420), self.name, keeps_colours=True)

    def _ended(self, complaints: IO[bytes]) -> Gloc3Error:
        """With what the program has said is wrong: its first line with an error, or its last line."""
        complaints.seek(0)
        lines = complaints.read().decode("utf-8", "replace").strip().splitlines()
        why = next((line for line in lines if "error" in line.lower()), lines[-1] if lines else "it said nothing")
        return Gloc3Error(f"{self.name}: {self._command[0]} has ended: {why.strip()}")


def _pieces(file: int) -> Iterator[bytes | None]:
    """What comes through a pipe; None after a while without anything, and nothing (`b""`) at its end."""
    while True:
        is_ready, _, _ = select.select([file], [], [], WAIT_S)
        yield os.read(file, 1 << 20) if is_ready else None


def gstreamer_camera(name: str, url: SourceUrl, now_s: Callable[[], float]) -> ProgramCamera:
    """A pipeline that ends in `appsink`, run by GStreamer's own program; in grey if the pipeline is.

    Raises:
        Refused: a quotation mark in it has no other.
    """
    pipeline = re.sub(r"!\s*appsink\b[^!]*$", "", url.place)
    tail = "! videoconvert ! video/x-raw,format=I420 ! y4menc ! fdsink fd=1"
    if "format=GRAY8" in pipeline:
        url = url._replace(options={"pixels": GREY})
    try:
        elements = shlex.split(f"{pipeline} {tail}")
    except ValueError as error:
        raise Refused(f"{name}: {url.text!r}: {error}") from error
    return ProgramCamera(name, [GSTREAMER, "-q", *elements], None, url, now_s)


def _make_pipeline(request: SourceRequest) -> Any:
    """By GStreamer's program, or by an OpenCV that has GStreamer."""
    name, url = camera_name(request.device), request.url
    has_program = shutil.which(GSTREAMER) is not None
    camera: ProgramCamera | VideoCamera = (
        gstreamer_camera(name, url, request.now_s)
        if has_program
        else VideoCamera(name, url, request.host.folder, request.now_s)
    )
    return SideBySide(camera, pair_names(request.device)) if request.sensor.name == STEREO else camera


def _of_pipeline(url: SourceUrl) -> Sequence[Path]:
    return [Path(path) for path in re.findall(r"/dev/video\d+", url.place)]


def _make(request: SourceRequest) -> ProgramCamera | SideBySide:
    url, name = request.url, camera_name(request.device)
    size = int(url.number("width", SIZE[0])), int(url.number("height", SIZE[1]))
    if size[0] % STRIDE or size[1] % 2:
        raise Refused(f"{request.device}: {url.text!r}: width must be a multiple of {STRIDE}, and height even")
    if not url.place.isdecimal():
        raise Refused(f"{request.device}: {url.text!r}: name the camera by its number in `rpicam-hello --list-cameras`")
    program = next(filter(shutil.which, RPICAM), RPICAM[0])
    options = {"timeout": 0, "camera": url.place, "width": size[0], "height": size[1], "codec": "yuv420", "output": "-"}
    options["framerate"] = f"{url.number('rate_hz', RATE_HZ):g}"
    if "exposure_s" in url.options:
        options["shutter"] = round(url.number("exposure_s", 0.0) * 1e6)
    if "gain" in url.options:
        options["gain"] = url.options["gain"]
    command = [
        program,
        "--nopreview",
        *(part for option, value in options.items() for part in (f"--{option}", str(value))),
    ]
    camera = ProgramCamera(name, command, size, url, request.now_s)
    return SideBySide(camera, pair_names(request.device)) if request.sensor.name == STEREO else camera


def _problem() -> str:
    is_there = any(map(shutil.which, RPICAM))
    return "" if is_there else f"{RPICAM[0]} is not installed; Raspberry Pi OS: sudo apt install rpicam-apps"


SOURCES: Final = (
    SourceKind(
        "gst",
        EYES,
        "gst://v4l2src ! videoconvert ! appsink",
        _make_pipeline,
        is_verbatim=True,
        group=VIDEO_GROUP,
        device_files=_of_pipeline,
    ),
    SourceKind(
        "libcamera",
        EYES,
        "libcamera://0?width=640&height=480&rate_hz=30",
        _make,
        {
            "width": Number(STRIDE, 8192, True),
            "height": Number(2, 8192, True),
            **RATE,
            "exposure_s": Number(1e-6, 10.0),
            "gain": Number(1.0, 64.0),
            **DELAY,
            **PIXELS,
        },
        problem=_problem,
    ),
)
