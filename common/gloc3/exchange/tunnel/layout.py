"""Common layout of the tunnel's frames: version, kinds, header, sizes, roles and lanes."""

from __future__ import annotations

import struct
import zlib
from enum import IntEnum
from typing import Final

PAYLOAD_TYPE: Final = 0xC103
"""In the range of TUNNEL's payload types that is free for private use."""
VERSION: Final = 1
MAX_PAYLOAD: Final = 128
WIRE_OVERHEAD: Final = 17
"""Bytes of a MAVLink 2 TUNNEL frame around our payload, without a signature."""
HEADER: Final = struct.Struct("<BBI")
"""Version, kind, and the boot number of the process that sends."""
ROOM: Final = MAX_PAYLOAD - HEADER.size
"""Bytes behind the header."""
_CHECK: Final = struct.Struct("<I")
SEALED_ROOM: Final = ROOM - _CHECK.size
"""Bytes between header and check sum."""


class FrameKind(IntEnum):
    """What a frame is."""

    HELLO = 1
    TABLE = 2
    REQUEST = 3
    STATUS = 4
    STATUS_PART = 5
    SUMMARY = 6
    DATA = 7
    ACK = 8
    REFUSAL = 9


class TunnelRole(IntEnum):
    """Which end of the link."""

    PLATFORM = 0
    STATION = 1


class Lane(IntEnum):
    """Reliable messages of one lane arrive in order; lanes overtake each other."""

    URGENT = 0
    ORDINARY = 1
    BULK = 2
    VIEW = 3
    """Samples for viewers that do not fit few frames: after everything else, within a limited share."""


DUTIES: Final = (Lane.URGENT, Lane.ORDINARY, Lane.BULK)
"""Lanes of messages that must arrive."""


SEALED: Final = frozenset({FrameKind.HELLO, FrameKind.TABLE, FrameKind.REQUEST, FrameKind.ACK, FrameKind.REFUSAL})
"""Frames with their own checksum: one damaged frame that passed MAVLink's 16-bit checksum could do lasting harm."""


def seal(frame: bytes) -> bytes:
    """The frame with its check sum."""
    return frame + _CHECK.pack(zlib.crc32(frame))


def unseal(payload: bytes) -> bytes | None:
    """The frame without its check sum; None where that is wrong."""
    frame = payload[: -_CHECK.size]
    return frame if _CHECK.pack(zlib.crc32(frame)) == payload[-_CHECK.size :] else None


def header(kind: FrameKind, boot: int) -> bytes:
    """Header of every frame."""
    return HEADER.pack(VERSION, kind, boot)
