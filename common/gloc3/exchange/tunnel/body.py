"""Body of a message's frames behind its channel: time, payload, and a checksum for reliable messages."""

from __future__ import annotations

import struct
import zlib
from typing import Any, Final

import msgspec

from gloc3.errors import UNREADABLE
from gloc3.exchange.tunnel.reader import ByteReader, TunnelFrameError, varint
from gloc3.messages.envelope import Envelope, Message
from gloc3.messages.wire import from_array, to_array

MAX_UNPACKED: Final = 512 * 1024
"""Bytes of a payload after inflating; what claims more is damaged."""
_SMALL: Final = 96
"""Payloads up to this many bytes are never worth deflating."""
_DEFLATED: Final = 1

_STATUS: Final = struct.Struct("<dB")
_CHECK: Final = struct.Struct("<I")


class ReliableBody(msgspec.Struct, frozen=True):
    """The envelope's remainder in a reliable message."""

    channel: int
    sequence: int
    t_s: float
    payload: bytes
    row: bytes = b""
    """Channel's row of the sender's table, until the sender knows that the receiver has it."""


def pack_payload(message: Message) -> tuple[int, bytes]:
    """Packs a message as msgpack, deflated (flag 1) where that makes it shorter."""
    plain = msgspec.msgpack.encode(to_array(message))
    if len(plain) > _SMALL:
        deflated = zlib.compress(plain, 9)
        if len(deflated) < len(plain):
            return _DEFLATED, deflated
    return 0, plain


def unpack_payload(payload: bytes, message_type: type[Message]) -> Any:
    """The message in a payload.

    Raises:
        TunnelFrameError: the bytes are damaged.
        WireError: they do not fit the type.
    """
    try:
        array = msgspec.msgpack.decode(payload)
    except UNREADABLE as error:
        raise TunnelFrameError(f"damaged payload: {error}") from error
    return from_array(array, message_type)


def pack_status(envelope: Envelope[Any]) -> bytes:
    """Time and payload of a best-effort message."""
    flags, payload = pack_payload(envelope.payload)
    return _STATUS.pack(envelope.t_s, flags) + payload


def unpack_status(body: bytes) -> tuple[float, bytes]:
    """Time and payload, inflated.

    Raises:
        TunnelFrameError: the bytes are damaged.
    """
    reader = ByteReader(body)
    t_s, flags = reader.time(), reader.byte()
    return t_s, _inflate(flags, reader.remainder())


def pack_reliable(envelope: Envelope[Any], channel: int, row: bytes) -> bytes:
    """Packs a whole reliable message; `row` is empty where the receiver knows the channel."""
    flags, payload = pack_payload(envelope.payload)
    body = varint(channel) + varint(envelope.sequence) + _STATUS.pack(envelope.t_s, flags)
    body += varint(len(row)) + row + payload
    return _CHECK.pack(zlib.crc32(body)) + body


def unpack_reliable(body: bytes) -> ReliableBody:
    """What `pack_reliable` wrote, inflated.

    Raises:
        TunnelFrameError: the bytes are damaged.
    """
    reader = ByteReader(body)
    (check,) = reader.unpack(_CHECK)
    if zlib.crc32(body[_CHECK.size :]) != check:
        raise TunnelFrameError("the check sum is wrong")
    channel, sequence, t_s, flags = reader.varint(), reader.varint(), reader.time(), reader.byte()
    row = reader.chunk(reader.varint())
    return ReliableBody(channel, sequence, t_s, _inflate(flags, reader.remainder()), row)


def _inflate(flags: int, payload: bytes) -> bytes:
    if not flags & _DEFLATED:
        return payload
    try:
        inflater = zlib.decompressobj()
        plain = inflater.decompress(payload, MAX_UNPACKED)
    except zlib.error as error:
        raise TunnelFrameError(f"damaged payload: {error}") from error
    if not inflater.eof:
        raise TunnelFrameError(f"a payload is cut off, or longer than {MAX_UNPACKED} bytes")
    return plain
