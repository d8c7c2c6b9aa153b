"""What all frames of the tunnel share: version, kinds, header, sizes, roles and lanes."""

from __future__ import annotations

import struct
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


class FrameKind(IntEnum):
    """What a frame is."""

    HELLO = 1
    TABLE = 2
    ASK = 3
    STATUS = 4
    STATUS_PART = 5
    SUMMARY = 6
    DATA = 7
    ACK = 8
    REFUSAL = 9


class Role(IntEnum):
    """Which end of the link."""

    PLATFORM = 0
    STATION = 1


class Lane(IntEnum):
    """Reliable messages of one lane arrive in order; lanes overtake each other."""

    URGENT = 0
    ORDINARY = 1
    BULK = 2


def header(kind: FrameKind, boot: int) -> bytes:
    """How every frame begins."""
    return HEADER.pack(VERSION, kind, boot)
