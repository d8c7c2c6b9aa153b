"""Cursor over the bytes of one frame, and numbers of variable length."""

from __future__ import annotations

import struct
from math import isfinite
from typing import Final

from gloc3.errors import Gloc3Error

_VARINT_BITS: Final = 63


class TunnelFrameError(Gloc3Error):
    """A frame that is damaged or invalid; the text gives the reason."""


class ByteReader:
    """Reads values from the front of some bytes; missing bytes raise `TunnelFrameError`, never another exception."""

    __slots__ = ("_at", "_data")

    def __init__(self, data: bytes, at: int = 0) -> None:
        self._data = data
        self._at = at

    @property
    def is_at_end(self) -> bool:
        """Whether nothing is left."""
        return self._at >= len(self._data)

    def unpack(self, layout: struct.Struct) -> tuple[int, ...]:
        """Whole numbers in a fixed layout."""
        at = self._at
        self._at = at + layout.size
        if self._at > len(self._data):
            raise TunnelFrameError("the frame is cut off")
        return layout.unpack_from(self._data, at)

    def time(self) -> float:
        """Seconds in eight bytes, finite."""
        t_s = float(_DOUBLE.unpack(self.chunk(8))[0])
        if not isfinite(t_s):
            raise TunnelFrameError("a time is not finite")
        return t_s

    def byte(self) -> int:
        """One byte as a number."""
        return self.chunk(1)[0]

    def chunk(self, count: int) -> bytes:
        """So many bytes."""
        at = self._at
        self._at = at + count
        if self._at > len(self._data):
            raise TunnelFrameError("the frame is cut off")
        return self._data[at : self._at]

    def remainder(self) -> bytes:
        """All that is left."""
        at, self._at = self._at, len(self._data)
        return self._data[at:]

    def text(self, count: int | None = None) -> str:
        """UTF-8 text of `count` bytes, or of all remaining ones."""
        try:
            return (self.remainder() if count is None else self.chunk(count)).decode()
        except UnicodeDecodeError as error:
            raise TunnelFrameError("a text is no UTF-8") from error

    def varint(self) -> int:
        """A number in as many bytes as it needs, seven bits each, the lowest first."""
        value = shift = 0
        while True:
            byte = self.byte()
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
            shift += 7
            if shift > _VARINT_BITS:
                raise TunnelFrameError("a number has no end")


def varint(value: int) -> bytes:
    """Encodes a non-negative number as read by `ByteReader.varint`."""
    if value < 0x80:
        return bytes((value,))
    parts = bytearray()
    while value >= 0x80:
        parts.append(value & 0x7F | 0x80)
        value >>= 7
    parts.append(value)
    return bytes(parts)


def unwrap(low: int, near: int, bits: int = 16) -> int:
    """The number with these low bits that is nearest to `near`; never negative."""
    span = 1 << bits
    value = near - (near & (span - 1)) + low
    if value - near > span // 2:
        value -= span
    elif near - value > span // 2:
        value += span
    return value if value >= 0 else value + span


_DOUBLE: Final = struct.Struct("<d")
