"""RTCM 3 frames, the corrections of a satellite base: found in a stream of bytes, checked, and identified by their type.

RTCM 10403.3: a preamble, ten bits of length, the payload and its CRC-24Q. Of the payloads only the type is read, and
the position of the base (messages 1005 and 1006).
"""

from typing import Final, NamedTuple

PREAMBLE: Final = 0xD3
HEADER_BYTES: Final = 3
CRC_BYTES: Final = 3
_POLYNOMIAL: Final = 0x1864CFB
_ECEF_AT: Final = (34, 74, 114)
"""Bits of the payload of 1005 and 1006 at which x, y and z begin, each of 38 bits in units of 0.1 mm."""
_POSITION_BITS: Final = 152
_EARTH_M: Final = (6.2e6, 6.6e6)
"""Distances from the centre of the Earth between which a base may stand, m."""
BASE_POSITION: Final = frozenset({1005, 1006})


def _table() -> tuple[int, ...]:
    found = []
    for byte in range(256):
        crc = byte << 16
        for _ in range(8):
            crc = crc << 1 ^ (_POLYNOMIAL if crc & 0x800000 else 0)
        found.append(crc & 0xFFFFFF)
    return tuple(found)


_CRC: Final = _table()


def crc24q(data: bytes) -> int:
    """CRC-24Q of some bytes."""
    crc = 0
    for byte in data:
        crc = (crc << 8 & 0xFFFFFF) ^ _CRC[crc >> 16 ^ byte]
    return crc


def is_observation(message_type: int) -> bool:
    """Whether a message holds what a base observes: its age is the age of the corrections."""
    return 1001 <= message_type <= 1004 or 1009 <= message_type <= 1012 or 1071 <= message_type <= 1137


class RtcmFrame(NamedTuple):
    """A frame whose CRC is right."""

    raw: bytes
    """The whole frame, as a receiver takes it."""

    @property
    def message_type(self) -> int:
        """Number of the message, such as 1077; 0 for a frame without a payload."""
        return (self.raw[3] << 4 | self.raw[4] >> 4) if len(self.raw) > HEADER_BYTES + CRC_BYTES + 1 else 0

    def base_ecef_m(self) -> tuple[float, float, float] | None:
        """Antenna of the base in ECEF, m; None where this is not a plausible message 1005 or 1006."""
        payload = self.raw[HEADER_BYTES:-CRC_BYTES]
        if self.message_type not in BASE_POSITION or 8 * len(payload) < _POSITION_BITS:
            return None
        bits = int.from_bytes(payload, "big")
        x, y, z = (_signed(bits >> (8 * len(payload) - at - 38) & (1 << 38) - 1) / 1e4 for at in _ECEF_AT)
        return (x, y, z) if _EARTH_M[0] < (x * x + y * y + z * z) ** 0.5 < _EARTH_M[1] else None


def _signed(value: int) -> int:
    return value - (1 << 38) if value >> 37 else value


class RtcmParser:
    """Finds frames in a stream that may also hold other protocols of a receiver."""

    def __init__(self) -> None:
        self.damaged = 0
        """Frames whose CRC was wrong; they are dropped."""
        self._data = bytearray()
        self._suspect_bytes = 0
        """So many of the next bytes belong to a damaged frame: preambles among them are not counted again."""

    def receive(self, data: bytes) -> list[RtcmFrame]:
        """Takes bytes of the stream.

        Returns:
            The frames that are complete now.
        """
        self._data += data
        found: list[RtcmFrame] = []
        while (start := self._data.find(PREAMBLE)) >= 0:
            self._drop(start)
            if len(self._data) < HEADER_BYTES:
                return found
            if self._data[1] & 0xFC:
                self._drop(1)
                continue
            length = HEADER_BYTES + ((self._data[1] & 3) << 8 | self._data[2]) + CRC_BYTES
            if len(self._data) < length:
                return found
            raw = bytes(self._data[:length])
            if crc24q(raw[:-CRC_BYTES]) == int.from_bytes(raw[-CRC_BYTES:], "big"):
                self._suspect_bytes = 0
                self._drop(length)
                found.append(RtcmFrame(raw))
                continue
            if not self._suspect_bytes:
                self.damaged += 1
                self._suspect_bytes = length
            self._drop(1)
        self._drop(len(self._data))
        return found

    def _drop(self, count: int) -> None:
        del self._data[:count]
        self._suspect_bytes = max(0, self._suspect_bytes - count)
