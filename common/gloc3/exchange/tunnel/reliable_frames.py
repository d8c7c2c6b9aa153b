"""The frames of the reliable transfer: fragments, what came of them, and refusals."""

from __future__ import annotations

import struct
import zlib
from typing import Final

import msgspec

from gloc3.exchange.tunnel.layout import HEADER, ROOM, SEALED_ROOM, FrameKind, Lane, header, seal
from gloc3.exchange.tunnel.reader import ByteReader, TunnelFrameError

_KEY: Final = struct.Struct("<H")
_DATA: Final = struct.Struct("<BHHHH")
_ACK: Final = struct.Struct("<HHHB")
_LANE: Final = struct.Struct("<BHB")
_REFUSAL: Final = struct.Struct("<HBH")
_SEALED_SIZE: Final = HEADER.size + SEALED_ROOM

CHUNK: Final = ROOM - _KEY.size - _DATA.size
"""Bytes of a reliable message in one frame."""
ACK_DELAY_UNIT_S: Final = 0.004


class Data(msgspec.Struct, frozen=True):
    """A fragment of a reliable message.

    The receiver's boot number is sent XORed with a check sum of what follows it, so that a damaged frame is for nobody.
    """

    to_boot: int
    """Low 16 bits of the receiver's boot number."""
    lane: Lane
    is_last: bool
    """Nothing else waits to be sent: acknowledge at once."""
    base_delta: int
    """How many of the numbers before this one are still open at the sender; what is older will not come any more."""
    number: int
    """Of the message in its lane, modulo 2**16."""
    serial: int
    """Of this transmission, modulo 2**16: each repeat has one of its own, so that a loss is told from a delay."""
    index: int
    count: int
    """Fragments of the message."""
    chunk: bytes

    def encode(self, boot: int) -> bytes:
        """The frame."""
        flags = self.lane | self.is_last << 2 | self.base_delta << 3
        rest = _DATA.pack(flags, self.number & 0xFFFF, self.serial & 0xFFFF, self.index, self.count) + self.chunk
        return header(FrameKind.DATA, boot) + _KEY.pack(self.to_boot ^ (zlib.crc32(rest) & 0xFFFF)) + rest

    @classmethod
    def decode(cls, reader: ByteReader) -> Data:
        """Reads what `encode` wrote."""
        (key,) = reader.unpack(_KEY)
        rest = reader.remainder()
        reader = ByteReader(rest)
        flags, number, serial, index, count = reader.unpack(_DATA)
        to_boot = key ^ (zlib.crc32(rest) & 0xFFFF)
        return cls(
            to_boot, Lane(flags & 3), bool(flags & 4), flags >> 3, number, serial, index, count, reader.remainder()
        )


class LaneReport(msgspec.Struct, frozen=True):
    """What has come in a lane."""

    lane: Lane
    expected: int
    """Everything before this number is done; modulo 2**16."""
    partial: tuple[tuple[int, int | None], ...] = ()
    """How far a message is ahead of `expected`, and the fragments that are here as bits; None for all of them."""


class Ack(msgspec.Struct, frozen=True):
    """Everything that a receiver has from one sender; the next one says it again, so that any may be lost."""

    to_boot: int
    highest: int
    """The latest serial that came, modulo 2**16."""
    received: int
    """Data frames so far, modulo 2**16: what is missing against the serials is the loss."""
    delay_s: float
    """Since `highest` came."""
    lanes: tuple[LaneReport, ...]

    def encode(self, boot: int) -> bytes:
        """The frame; partial messages that do not fit are left for the next one."""
        delay = min(255, round(self.delay_s / ACK_DELAY_UNIT_S))
        frame = header(FrameKind.ACK, boot) + _ACK.pack(
            self.to_boot, self.highest & 0xFFFF, self.received & 0xFFFF, delay
        )
        for report in self.lanes:
            parts, count = b"", 0
            for ahead, mask in report.partial:
                bits = b"" if mask is None else mask.to_bytes((mask.bit_length() + 7) // 8, "little")
                part = bytes((ahead | (0x80 if mask is None else 0), len(bits))) + bits
                if len(frame) + _LANE.size + len(parts) + len(part) <= _SEALED_SIZE:
                    parts, count = parts + part, count + 1
            if len(frame) + _LANE.size + len(parts) <= _SEALED_SIZE:
                frame += _LANE.pack(report.lane, report.expected & 0xFFFF, count) + parts
        return seal(frame)

    @classmethod
    def decode(cls, reader: ByteReader) -> Ack:
        """Reads what `encode` wrote."""
        to_boot, highest, received, delay = reader.unpack(_ACK)
        lanes = []
        while not reader.is_at_end:
            lane, expected, count = reader.unpack(_LANE)
            if lane > Lane.VIEW:
                raise TunnelFrameError("there are four lanes")
            partial: list[tuple[int, int | None]] = []
            for _ in range(count):
                ahead, size = reader.byte(), reader.byte()
                bits = int.from_bytes(reader.chunk(size), "little")
                partial.append((ahead & 0x7F, None if ahead & 0x80 else bits))
            lanes.append(LaneReport(Lane(lane), expected, tuple(partial)))
        return cls(to_boot, highest, received, delay * ACK_DELAY_UNIT_S, tuple(lanes))


class Refusal(msgspec.Struct, frozen=True):
    """A reliable message that was not handed over and will not be."""

    to_boot: int
    lane: Lane
    number: int
    reason: str

    def encode(self, boot: int) -> bytes:
        """The frame; a long reason is cut."""
        frame = header(FrameKind.REFUSAL, boot) + _REFUSAL.pack(self.to_boot, self.lane, self.number & 0xFFFF)
        reason = self.reason.encode()[: _SEALED_SIZE - len(frame)]
        return seal(frame + reason.decode(errors="ignore").encode())

    @classmethod
    def decode(cls, reader: ByteReader) -> Refusal:
        """Reads what `encode` wrote."""
        to_boot, lane, number = reader.unpack(_REFUSAL)
        if lane > Lane.VIEW:
            raise TunnelFrameError("there are four lanes")
        return cls(to_boot, Lane(lane), number, reader.text())
