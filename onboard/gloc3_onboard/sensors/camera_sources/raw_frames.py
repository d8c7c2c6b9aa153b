"""Frames that programs write to a pipe: Y4M (`yuv4mpegpipe`), or raw YUV 4:2:0 of a known size."""

import re
from typing import Final, NamedTuple

from gloc3.errors import Gloc3Error

MOST_PIXELS: Final = 16_000_000
LONGEST_LINE: Final = 1000
_HEADER: Final = re.compile(rb"YUV4MPEG2( [ -~]*)?")


class RawFrame(NamedTuple):
    """One frame."""

    width: int
    height: int
    is_grey: bool
    data: bytes
    """Rows of grey values (Y), `width * height` bytes, and unless `is_grey` those of U and V, a quarter of it each."""


class RawFrameReader:
    """Cuts frames out of a stream.

    Args:
        size: width and height of raw frames, both even; None for Y4M, which says it.
    """

    def __init__(self, size: tuple[int, int] | None = None) -> None:
        self._has_lines = size is None
        self._form = None if size is None else (*size, False)
        self._remainder = bytearray()

    def receive(self, data: bytes) -> list[RawFrame]:
        """Receives bytes and returns the frames that are complete.

        Raises:
            Gloc3Error: the bytes are no such frames; the message says which would be.
        """
        self._remainder += data
        found: list[RawFrame] = []
        while (frame := self._next()) is not None:
            found.append(frame)
        return found

    def _next(self) -> RawFrame | None:
        if self._form is None:
            line = self._line(0)
            if line is None:
                return None
            self._form = _form_of(line)
            del self._remainder[: len(line) + 1]
        begin = 0
        if self._has_lines:
            line = self._line(0)
            if line is None:
                return None
            if not line.startswith(b"FRAME"):
                raise Gloc3Error("what follows a frame is none")
            begin = len(line) + 1
        width, height, is_grey = self._form
        end = begin + (width * height if is_grey else width * height * 3 // 2)
        if len(self._remainder) < end:
            return None
        data = bytes(self._remainder[begin:end])
        del self._remainder[:end]
        return RawFrame(width, height, is_grey, data)

    def _line(self, begin: int) -> bytes | None:
        """The line at a place; None while it is not complete."""
        end = self._remainder.find(b"\n", begin, begin + LONGEST_LINE)
        if end < 0 and len(self._remainder) > LONGEST_LINE:
            raise Gloc3Error("it is no stream of Y4M")
        return bytes(self._remainder[begin:end]) if end >= 0 else None


def _form_of(header: bytes) -> tuple[int, int, bool]:
    """Width, height, and whether frames are grey."""
    if _HEADER.fullmatch(header) is None:
        raise Gloc3Error("it is no stream of Y4M")
    fields = {part[:1]: part[1:] for part in header.decode("ascii").split()[1:]}
    size, colours = [fields.get(key, "") for key in "WH"], fields.get("C", "420")
    if not all(text.isdecimal() and len(text) < 6 for text in size):
        raise Gloc3Error("the header has no width and height")
    width, height = map(int, size)
    if colours not in ("420", "420jpeg", "420mpeg2", "420paldv", "mono"):
        raise Gloc3Error(f"frames of {colours} are not read; use 4:2:0 (I420) with 8 bits")
    if not 0 < width * height <= MOST_PIXELS or (colours != "mono" and (width % 2 or height % 2)):
        raise Gloc3Error(f"frames of {width} x {height} pixels are not read")
    return width, height, colours == "mono"
