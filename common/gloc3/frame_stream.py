"""Camera frames as a byte stream: how a simulated camera reaches a companion process over TCP on the same machine.

Each frame is a header (magic, time in microseconds since the vehicle's boot, width, height, length of the camera's
name), the name, and rows of 8-bit grey values.
"""

import struct
from typing import Final, NamedTuple

from gloc3.errors import Gloc3Error, Misuse

MAGIC: Final = b"G3F1"
_HEADER: Final = struct.Struct("<4sQHHB")
MOST_PIXELS: Final = 16_000_000


class FrameError(Gloc3Error):
    """The stream is not one of frames."""


class GreyFrame(NamedTuple):
    """One camera frame."""

    boot_us: int
    """Time of exposure, in microseconds since boot of the vehicle."""
    camera: str
    width: int
    height: int
    data: bytes
    """Rows of 8-bit grey values, `height * width` bytes."""


def encode(frame: GreyFrame) -> bytes:
    """A frame as bytes.

    Raises:
        Misuse: the data is not that of the frame's width and height, or a number does not fit.
    """
    name = frame.camera.encode()
    is_whole = 0 < frame.width * frame.height == len(frame.data) <= MOST_PIXELS
    if not is_whole or len(name) > 255 or max(frame.width, frame.height) > 0xFFFF or frame.boot_us < 0:
        raise Misuse(f"{len(frame.data)} bytes are no frame of {frame.width} x {frame.height} pixels")
    return _HEADER.pack(MAGIC, frame.boot_us, frame.width, frame.height, len(name)) + name + frame.data


class FrameReader:
    """Cuts frames out of a stream."""

    def __init__(self) -> None:
        self._rest = bytearray()

    def receive(self, data: bytes) -> list[GreyFrame]:
        """Takes bytes in, gives the frames that are complete.

        Raises:
            FrameError: the bytes are no frames; the stream must be opened anew.
        """
        self._rest += data
        frames: list[GreyFrame] = []
        while len(self._rest) >= _HEADER.size:
            magic, boot_us, width, height, name_length = _HEADER.unpack_from(self._rest)
            if magic != MAGIC or not 0 < width * height <= MOST_PIXELS:
                raise FrameError("this is no stream of camera frames")
            begin = _HEADER.size + name_length
            end = begin + width * height
            if len(self._rest) < end:
                break
            name = bytes(self._rest[_HEADER.size : begin]).decode("ascii", "replace")
            frames.append(GreyFrame(boot_us, name, width, height, bytes(self._rest[begin:end])))
            del self._rest[:end]
        return frames
