"""Sensor data as a byte stream: carries simulated camera frames and scans to a companion process on the same machine.

Each record is a header (magic, time in microseconds since the vehicle's boot, sizes, length of the sensor's name), the
name, and the data: rows of 8-bit grey values of a camera's frame (with another magic, rows of blue, green and red follow),
rows of 16-bit depths of a depth camera's, or 32-bit ranges of a scan. The two frames of a stereo pair are two records with one time. A client first sends one line
with the names of the sensors that it wants, separated by spaces; a camera's name with `COLOUR` behind it for its
pictures in colour.
"""

import math
import struct
from typing import Final, NamedTuple

from gloc3.errors import Gloc3Error, Misuse

MAGIC: Final = b"G3F1"
COLOUR_MAGIC: Final = b"G3C1"
SCAN_MAGIC: Final = b"G3S1"
DEPTH_MAGIC: Final = b"G3D1"
COLOUR: Final = ":colour"
_HEADER: Final = struct.Struct("<4sQHHB")
_SCAN_HEADER: Final = struct.Struct("<4sQHB5f")
_DEPTH_HEADER: Final = struct.Struct("<4sQHHB3f")
MOST_PIXELS: Final = 16_000_000
MOST_REQUEST_BYTES: Final = 1024
"""The longest line of a client."""


class FrameError(Gloc3Error):
    """The stream is not one of frames."""


class CameraFrame(NamedTuple):
    """One camera frame."""

    boot_us: int
    """Time of exposure, in microseconds since boot of the vehicle."""
    camera: str
    width: int
    height: int
    data: bytes
    """Rows of 8-bit grey values, `height * width` bytes."""
    bgr: bytes = b""
    """Rows of 8-bit blue, green and red, `3 * height * width` bytes; empty without colours."""


class ScanFrame(NamedTuple):
    """One turn of a range scanner; as `gloc3.messages.perception.LaserScan`, its numbers in 32 bits."""

    boot_us: int
    """Time of the last beam, in microseconds since boot of the vehicle."""
    scanner: str
    angle_min_rad: float
    angle_step_rad: float
    range_min_m: float
    range_max_m: float
    duration_s: float
    ranges_m: bytes
    """32-bit floats, little endian, one a beam."""


class DepthFrame(NamedTuple):
    """A depth camera's frame; as `gloc3.messages.perception.DepthImage`, its numbers in 32 bits."""

    boot_us: int
    """Time of exposure, in microseconds since boot of the vehicle."""
    camera: str
    width: int
    height: int
    scale_m: float
    range_min_m: float
    range_max_m: float
    data: bytes
    """Rows of 16-bit unsigned integers, little endian, `2 * height * width` bytes."""


StreamRecord = CameraFrame | DepthFrame | ScanFrame


def encode(frame: CameraFrame) -> bytes:
    """A frame as bytes.

    Raises:
        Misuse: the data is not that of the frame's width and height, or a number does not fit.
    """
    name = frame.camera.encode()
    is_whole = 0 < frame.width * frame.height == len(frame.data) <= MOST_PIXELS
    is_whole = is_whole and len(frame.bgr) in (0, 3 * len(frame.data))
    if not is_whole or len(name) > 255 or max(frame.width, frame.height) > 0xFFFF or frame.boot_us < 0:
        raise Misuse(f"{len(frame.data)} bytes are not a frame of {frame.width} x {frame.height} pixels")
    magic = COLOUR_MAGIC if frame.bgr else MAGIC
    header = _HEADER.pack(magic, frame.boot_us, frame.width, frame.height, len(name))
    return b"".join((header, name, frame.data, frame.bgr))


def encode_scan(scan: ScanFrame) -> bytes:
    """A scan as bytes.

    Raises:
        Misuse: it has no beams or too many, or a number does not fit.
    """
    name, (beams, rest) = scan.scanner.encode(), divmod(len(scan.ranges_m), 4)
    numbers = scan[2:7]
    if rest or not 0 < beams <= 0xFFFF or len(name) > 255 or scan.boot_us < 0 or not all(map(math.isfinite, numbers)):
        raise Misuse(f"{len(scan.ranges_m)} bytes are not a scan")
    return _SCAN_HEADER.pack(SCAN_MAGIC, scan.boot_us, beams, len(name), *numbers) + name + scan.ranges_m


def encode_depth(frame: DepthFrame) -> bytes:
    """A depth camera's frame as bytes.

    Raises:
        Misuse: the data is not that of the frame's width and height, or a number does not fit.
    """
    name, numbers = frame.camera.encode(), frame[4:7]
    is_whole = 0 < 2 * frame.width * frame.height == len(frame.data) <= 2 * MOST_PIXELS
    is_whole = is_whole and max(frame.width, frame.height) <= 0xFFFF and all(map(math.isfinite, numbers))
    if not is_whole or len(name) > 255 or frame.boot_us < 0:
        raise Misuse(f"{len(frame.data)} bytes are not depths of {frame.width} x {frame.height} pixels")
    header = _DEPTH_HEADER.pack(DEPTH_MAGIC, frame.boot_us, frame.width, frame.height, len(name), *numbers)
    return b"".join((header, name, frame.data))


def encode_stream_request(*sensors: str) -> bytes:
    """Encodes the line with which a client requests sensors by name."""
    return " ".join(sensors).encode() + b"\n"


def read_stream_request(line: bytes) -> frozenset[str]:
    """Parses the sensor names from a client's request line."""
    return frozenset(line.decode("ascii", "replace").split())


class FrameReader:
    """Cuts frames and scans out of a stream."""

    def __init__(self) -> None:
        self._remainder = bytearray()

    def receive(self, data: bytes) -> list[StreamRecord]:
        """Receives bytes and returns the records that are complete.

        Raises:
            FrameError: the bytes are not valid records; the stream must be reopened.
        """
        self._remainder += data
        found: list[StreamRecord] = []
        while len(self._remainder) >= _HEADER.size:
            magic = bytes(self._remainder[:4])
            used: tuple[StreamRecord, int] | None
            if magic in (MAGIC, COLOUR_MAGIC):
                used = self._frame(is_coloured=magic == COLOUR_MAGIC)
            elif magic == SCAN_MAGIC:
                used = self._scan()
            elif magic == DEPTH_MAGIC:
                used = self._depth()
            else:
                raise FrameError("not a stream of camera frames and scans")
            if used is None:
                break
            record, end = used
            found.append(record)
            del self._remainder[:end]
        return found

    def _frame(self, *, is_coloured: bool) -> tuple[CameraFrame, int] | None:
        _, boot_us, width, height, name_length = _HEADER.unpack_from(self._remainder)
        if not 0 < width * height <= MOST_PIXELS:
            raise FrameError(f"a frame of {width} x {height} pixels")
        begin = _HEADER.size + name_length
        middle = begin + width * height
        end = middle + (3 * width * height if is_coloured else 0)
        if len(self._remainder) < end:
            return None
        data, bgr = bytes(self._remainder[begin:middle]), bytes(self._remainder[middle:end])
        return CameraFrame(boot_us, self._name(_HEADER.size, begin), width, height, data, bgr), end

    def _scan(self) -> tuple[ScanFrame, int] | None:
        if len(self._remainder) < _SCAN_HEADER.size:
            return None
        _, boot_us, beams, name_length, *numbers = _SCAN_HEADER.unpack_from(self._remainder)
        if beams == 0 or not all(map(math.isfinite, numbers)):
            raise FrameError("a scan without beams or directions")
        begin = _SCAN_HEADER.size + name_length
        end = begin + 4 * beams
        if len(self._remainder) < end:
            return None
        least, step, near, far, duration = numbers
        name, ranges = self._name(_SCAN_HEADER.size, begin), bytes(self._remainder[begin:end])
        return ScanFrame(boot_us, name, least, step, near, far, duration, ranges), end

    def _depth(self) -> tuple[DepthFrame, int] | None:
        if len(self._remainder) < _DEPTH_HEADER.size:
            return None
        _, boot_us, width, height, name_length, *numbers = _DEPTH_HEADER.unpack_from(self._remainder)
        if not 0 < width * height <= MOST_PIXELS or not all(map(math.isfinite, numbers)):
            raise FrameError(f"depths of {width} x {height} pixels")
        begin = _DEPTH_HEADER.size + name_length
        end = begin + 2 * width * height
        if len(self._remainder) < end:
            return None
        scale, near, far = numbers
        name, data = self._name(_DEPTH_HEADER.size, begin), bytes(self._remainder[begin:end])
        return DepthFrame(boot_us, name, width, height, scale, near, far, data), end

    def _name(self, begin: int, end: int) -> str:
        return bytes(self._remainder[begin:end]).decode("ascii", "replace")
