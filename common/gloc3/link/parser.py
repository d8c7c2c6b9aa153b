"""Finds MAVLink frames in bytes: header and checksum only, so that routing never pays for decoding."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Final

import msgspec
from fastcrc.crc16 import mcrf4xx as checksum

from gloc3.link.message import Address, MavlinkMessage, Shape

MAGIC_1: Final = 0xFE
MAGIC_2: Final = 0xFD
SIGNED: Final = 0x01
"""The only incompatibility flag that the protocol knows."""
SIGNATURE_LENGTH: Final = 13

_HEADER_1 = struct.Struct("<BBBBBB").unpack_from
_HEADER_2 = struct.Struct("<BBBBBBBHB").unpack_from
_LENGTH_1: Final = 6
_LENGTH_2: Final = 10


class Frame(msgspec.Struct, frozen=True, gc=False):
    """One frame as it came; the checksum is right, or the message is not known and nobody can tell."""

    raw: bytes
    """The whole frame, ready to be forwarded."""
    system: int
    component: int
    sequence: int
    message_id: int
    flags: int
    """MAVLink 2 incompatibility flags."""
    start: int
    """Where the payload begins in `raw`."""
    length: int
    """Bytes of payload, after the sender has cut trailing zeros off."""
    shape: Shape | None
    """None for a message that the dialect does not know: it can be forwarded, not decoded."""

    @property
    def sender(self) -> Address:
        """Where it comes from."""
        return Address(self.system, self.component)

    @property
    def payload(self) -> bytes:
        """The payload as it came."""
        return self.raw[self.start : self.start + self.length]

    @property
    def is_signed(self) -> bool:
        """Whether a signature follows; whether it is genuine is for the signing to say."""
        return bool(self.flags & SIGNED)

    @property
    def target_system(self) -> int:
        """The system that it is addressed to; 0 for all, or when the message has no address."""
        return self._byte(self.shape.target_system_at) if self.shape is not None else 0

    @property
    def target_component(self) -> int:
        """The component that it is addressed to; 0 for all, or when the message has no address."""
        return self._byte(self.shape.target_component_at) if self.shape is not None else 0

    def decode(self) -> MavlinkMessage | None:
        """The message, or None for one that the dialect does not know."""
        return None if self.shape is None else self.shape.decode(self.raw, self.start, self.length)

    def _byte(self, offset: int) -> int:
        return self.raw[self.start + offset] if 0 <= offset < self.length else 0


class FrameParser:
    """Cuts frames out of a byte stream, or out of datagrams with a fresh state for each.

    Damaged input is never an exception: bytes that belong to no frame are counted, and the search goes on one byte
    after the false start, so that a good frame behind garbage is never swallowed. A frame of an unknown message has no
    checksum that could be tested, so it counts as one only if no good frame of a known message begins inside it.
    """

    def __init__(self, shapes: Mapping[int, Shape | None], *, is_datagram: bool = False) -> None:
        self._shapes = shapes
        self._is_datagram = is_datagram
        self._rest = b""
        self.frames_received = 0
        self.bytes_dropped = 0

    def receive(self, data: bytes) -> list[Frame]:
        """Takes bytes in, gives the frames that are complete.

        Args:
            data: what came: a piece of the stream of any length, or one whole datagram.
        """
        data = self._rest + data if self._rest else data
        frames: list[Frame] = []
        position, size, shapes = 0, len(data), self._shapes
        while position < size:
            if data[position] == MAGIC_2 and size - position >= _LENGTH_2 + 2:
                _, length, flags, _, sequence, system, component, low, high = _HEADER_2(data, position)
                end = position + length + (_LENGTH_2 + 2)
                shape = shapes[low | high << 16]
                if flags == 0 and end <= size and shape is not None:
                    body = end - 2
                    if checksum(shape.crc_extra, checksum(data[position + 1 : body])) == data[body] | data[end - 1] << 8:
                        raw = data[position:end]
                        frames.append(
                            Frame(raw, system, component, sequence, low | high << 16, 0, _LENGTH_2, length, shape)
                        )
                        position = end
                        continue
            frame = self._examine(data, position)
            if frame is None:
                position = self._next_magic(data, position + 1)
            elif isinstance(frame, Frame):
                frames.append(frame)
                position += len(frame.raw)
            elif self._is_datagram:
                position = self._next_magic(data, position + 1)
            else:
                break
        self._rest = b"" if self._is_datagram else data[position:]
        self.frames_received += len(frames)
        return frames

    def _next_magic(self, data: bytes, position: int) -> int:
        """Where the next frame may begin; what lies before it is dropped."""
        start = position - 1
        while position < len(data) and data[position] not in (MAGIC_1, MAGIC_2):
            position += 1
        self.bytes_dropped += position - start
        return position

