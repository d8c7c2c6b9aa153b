"""The frames of the tunnel: the payload of one MAVLink TUNNEL message (payload type 0xC103).

Every frame begins with the version, its kind and the boot number of the process that sends it. Numbers are little
endian; a *varint* has variable length. Frames to one peer contain the low half of its boot number, so that a restarted
process ignores frames for its predecessor.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping
from typing import Final, TypeAlias

import msgspec

from gloc3.exchange.tunnel.layout import (
    HEADER,
    ROOM,
    SEALED,
    SEALED_ROOM,
    VERSION,
    FrameKind,
    Lane,
    TunnelRole,
    header,
    seal,
    unseal,
)
from gloc3.exchange.tunnel.reader import ByteReader, TunnelFrameError, varint

_HELLO: Final = struct.Struct("<BHIH")
_ECHO: Final = struct.Struct("<BBIH")
_PART: Final = struct.Struct("<BBH")
_KEY: Final = struct.Struct("<H")
_DATA: Final = struct.Struct("<BHHHH")
_ACK: Final = struct.Struct("<HHHB")
_LANE: Final = struct.Struct("<BHB")
_REFUSAL: Final = struct.Struct("<HBH")
_SEALED_SIZE: Final = HEADER.size + SEALED_ROOM

MAX_NAME_BYTES: Final = 32
MAX_TOKENS: Final = 12
MAX_ECHOES: Final = 6
CHUNK: Final = ROOM - _KEY.size - _DATA.size
"""Bytes of a reliable message in one frame."""
ACK_DELAY_UNIT_S: Final = 0.004


class Echo(msgspec.Struct, frozen=True):
    """When a peer's last hello was sent, by its own clock, and how long ago it was received."""

    system: int
    component: int
    sent_ms: int
    """Modulo 2**32."""
    held_ms: int


class TunnelHello(msgspec.Struct, frozen=True):
    """Broadcast at 1 to 2 Hz: the sender's role and name, its clock, and the size of its table."""

    role: TunnelRole
    name: str
    table_size: int
    sent_ms: int
    """By the sender's clock; 48 bits."""
    echoes: tuple[Echo, ...] = ()
    tokens: tuple[int, ...] = ()
    """Table numbers of the sender's liveliness tokens."""

    def encode(self, boot: int) -> bytes:
        """The frame."""
        body = header(FrameKind.HELLO, boot) + _HELLO.pack(
            self.role, self.table_size, self.sent_ms & 0xFFFFFFFF, self.sent_ms >> 32 & 0xFFFF
        )
        body += bytes((len(self.echoes),)) + b"".join(
            _ECHO.pack(e.system, e.component, e.sent_ms & 0xFFFFFFFF, e.held_ms) for e in self.echoes
        )
        body += bytes((len(self.tokens),)) + b"".join(varint(token) for token in self.tokens)
        return seal(body + self.name.encode())

    @classmethod
    def decode(cls, reader: ByteReader) -> TunnelHello:
        """Reads what `encode` wrote."""
        role, table_size, low, high = reader.unpack(_HELLO)
        if role not in (TunnelRole.PLATFORM, TunnelRole.STATION):
            raise TunnelFrameError(f"unknown role {role}")
        echoes = tuple(Echo(*reader.unpack(_ECHO)) for _ in range(reader.byte()))
        tokens = tuple(reader.varint() for _ in range(reader.byte()))
        return cls(TunnelRole(role), reader.text(), table_size, low | high << 32, echoes, tokens)


class TunnelTable(msgspec.Struct, frozen=True):
    """Rows of the sender's table, as `OwnTable` encodes them."""

    rows: bytes

    def encode(self, boot: int) -> bytes:
        """The frame."""
        return seal(header(FrameKind.TABLE, boot) + self.rows)

    @classmethod
    def decode(cls, reader: ByteReader) -> TunnelTable:
        """Reads what `encode` wrote."""
        return cls(reader.remainder())


class TableRequest(msgspec.Struct, frozen=True):
    """Asks a peer for rows of its table."""

    numbers: tuple[int, ...]

    def encode(self, boot: int) -> bytes:
        """The frame."""
        return seal(header(FrameKind.REQUEST, boot) + b"".join(varint(number) for number in self.numbers))

    @classmethod
    def decode(cls, reader: ByteReader) -> TableRequest:
        """Reads what `encode` wrote."""
        numbers = []
        while not reader.is_at_end:
            numbers.append(reader.varint())
        return cls(tuple(numbers))


class Status(msgspec.Struct, frozen=True):
    """A best-effort message that fits one frame."""

    channel: int
    sequence: int
    body: bytes

    def encode(self, boot: int) -> bytes:
        """The frame."""
        return header(FrameKind.STATUS, boot) + varint(self.channel) + varint(self.sequence) + self.body

    @classmethod
    def decode(cls, reader: ByteReader) -> Status:
        """Reads what `encode` wrote."""
        return cls(reader.varint(), reader.varint(), reader.remainder())


class StatusPart(msgspec.Struct, frozen=True):
    """A part of a best-effort message; part number `count` is the parity of the others."""

    channel: int
    sequence: int
    index: int
    count: int
    size: int
    """Bytes of the whole message."""
    chunk: bytes

    def encode(self, boot: int) -> bytes:
        """The frame."""
        place = _PART.pack(self.index, self.count, self.size)
        return header(FrameKind.STATUS_PART, boot) + varint(self.channel) + varint(self.sequence) + place + self.chunk

    @classmethod
    def decode(cls, reader: ByteReader) -> StatusPart:
        """Reads what `encode` wrote."""
        channel, sequence = reader.varint(), reader.varint()
        index, count, size = reader.unpack(_PART)
        return cls(channel, sequence, index, count, size, reader.remainder())


class SummaryRows(msgspec.Struct, frozen=True):
    """Rows of the components' summary, as `summary.py` packs them."""

    channel: int
    sequence: int
    body: bytes

    def encode(self, boot: int) -> bytes:
        """The frame."""
        return header(FrameKind.SUMMARY, boot) + varint(self.channel) + varint(self.sequence) + self.body

    @classmethod
    def decode(cls, reader: ByteReader) -> SummaryRows:
        """Reads what `encode` wrote."""
        return cls(reader.varint(), reader.varint(), reader.remainder())


class Data(msgspec.Struct, frozen=True):
    """A fragment of a reliable message.

    The receiver's boot number is sent XORed with a checksum of the following bytes, so that no receiver accepts a
    damaged frame.
    """

    to_boot: int
    """Low 16 bits of the receiver's boot number."""
    lane: Lane
    is_last: bool
    """Nothing else waits to be sent: acknowledge at once."""
    base_delta: int
    """How far back the oldest message number still open at the sender is; older ones will not arrive any more."""
    number: int
    """Of the message in its lane, modulo 2**16."""
    serial: int
    """Of this transmission, modulo 2**16: each repeat has a new one, which distinguishes a loss from a delay."""
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
    """Data frames received so far, modulo 2**16: the difference from the serials is the loss."""
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


TunnelFrame: TypeAlias = (
    TunnelHello | TunnelTable | TableRequest | Status | StatusPart | SummaryRows | Data | Ack | Refusal
)

_DECODERS: Final[Mapping[int, Callable[[ByteReader], TunnelFrame]]] = {
    FrameKind.HELLO: TunnelHello.decode,
    FrameKind.TABLE: TunnelTable.decode,
    FrameKind.REQUEST: TableRequest.decode,
    FrameKind.STATUS: Status.decode,
    FrameKind.STATUS_PART: StatusPart.decode,
    FrameKind.SUMMARY: SummaryRows.decode,
    FrameKind.DATA: Data.decode,
    FrameKind.ACK: Ack.decode,
    FrameKind.REFUSAL: Refusal.decode,
}


class OtherVersion(TunnelFrameError):
    """The peer uses another version of the tunnel."""


def decode(payload: bytes) -> tuple[int, TunnelFrame]:
    """The sender's boot number and the frame in a TUNNEL payload.

    Raises:
        OtherVersion: it is of another version.
        TunnelFrameError: it is damaged or of an unknown kind.
    """
    if payload and payload[0] != VERSION:
        raise OtherVersion(f"versions differ: tunnel version {payload[0]} there, {VERSION} here")
    reader = ByteReader(payload)
    _, kind, boot = reader.unpack(HEADER)
    decoder = _DECODERS.get(kind)
    if decoder is None:
        raise TunnelFrameError(f"unknown kind of frame {kind}")
    if kind in SEALED:
        frame = unseal(payload)
        if frame is None or len(frame) < HEADER.size:
            raise TunnelFrameError("the check sum of a frame is wrong")
        reader = ByteReader(frame, HEADER.size)
    return boot, decoder(reader)
