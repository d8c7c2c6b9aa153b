"""The frames of the tunnel: what stands in the payload of one MAVLink TUNNEL message (payload type 0xC103).

Every frame begins with the version, its kind and the boot number of the process that sends it. Numbers are little
endian; a *varint* takes as many bytes as it needs. Frames to one peer name the low half of the boot number that they
are meant for, so that a restarted process does not take what was meant for its predecessor.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Final, TypeAlias

import msgspec

from gloc3.exchange.tunnel.layout import HEADER, SEALED, VERSION, FrameKind, TunnelRole, header, seal, unseal
from gloc3.exchange.tunnel.reader import ByteReader, TunnelFrameError, varint
from gloc3.exchange.tunnel.reliable_frames import Ack, Data, Refusal

_HELLO: Final = struct.Struct("<BHIH")
_ECHO: Final = struct.Struct("<BBIH")
_PART: Final = struct.Struct("<BBH")

MAX_NAME_BYTES: Final = 32
MAX_TOKENS: Final = 12
MAX_ECHOES: Final = 6


class Echo(msgspec.Struct, frozen=True):
    """When a peer's last greeting was sent, by its own clock, and how long ago it came."""

    system: int
    component: int
    sent_ms: int
    """Modulo 2**32."""
    held_ms: int


class TunnelHello(msgspec.Struct, frozen=True):
    """Broadcast a few times in two seconds: who is here, with its clock and how many numbers its table has."""

    role: TunnelRole
    name: str
    table_size: int
    sent_ms: int
    """By the sender's clock; 48 bits."""
    echoes: tuple[Echo, ...] = ()
    tokens: tuple[int, ...] = ()
    """Numbers of what is alive."""

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
        return seal(header(FrameKind.ASK, boot) + b"".join(varint(number) for number in self.numbers))

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


TunnelFrame: TypeAlias = (
    TunnelHello | TunnelTable | TableRequest | Status | StatusPart | SummaryRows | Data | Ack | Refusal
)

_DECODERS: Final[Mapping[int, Callable[[ByteReader], TunnelFrame]]] = {
    FrameKind.HELLO: TunnelHello.decode,
    FrameKind.TABLE: TunnelTable.decode,
    FrameKind.ASK: TableRequest.decode,
    FrameKind.STATUS: Status.decode,
    FrameKind.STATUS_PART: StatusPart.decode,
    FrameKind.SUMMARY: SummaryRows.decode,
    FrameKind.DATA: Data.decode,
    FrameKind.ACK: Ack.decode,
    FrameKind.REFUSAL: Refusal.decode,
}


class OtherVersion(TunnelFrameError):
    """The peer speaks another version of the tunnel."""


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
