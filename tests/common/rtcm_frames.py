"""RTCM 3 frames as a base sends them, for tests: bits written one field after the other."""

from gloc3.messages.frames import GeoPoint, ecef_from_geo
from gloc3.rtcm3 import crc24q

SAMPLE_1005 = bytes.fromhex("D300133ED7D30202980EDEEF34B4BD62AC0941986F33360B98")
"""The example of RTCM 10403: station 2003 at (1114104.5999, -4850729.7108, 3975521.4643)."""


def framed(payload: bytes) -> bytes:
    head = b"\xd3" + len(payload).to_bytes(2, "big") + payload
    return head + crc24q(head).to_bytes(3, "big")


def base_position(place: GeoPoint) -> bytes:
    """Message 1005."""
    x, y, z = (round(1e4 * axis) & (1 << 38) - 1 for axis in ecef_from_geo(place))
    bits = 1005 << 140 | 1 << 128 | 0b000000_1110 << 118 | x << 80 | y << 40 | z
    return framed(bits.to_bytes(19, "big"))


def observations(size: int = 150, message_type: int = 1077, number: int = 0) -> bytes:
    """A message of that type and payload size; what it says of satellites means nothing."""
    return framed((message_type << 4).to_bytes(2, "big") + bytes((number + index) % 251 for index in range(size - 2)))
