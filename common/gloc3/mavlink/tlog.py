"""`.tlog` files, as MAVProxy, pymavlink and Mission Planner write and read them: a time before each MAVLink frame."""

import struct
from typing import Final

_TIME: Final = struct.Struct(">Q").pack
OVERHEAD_BYTES: Final = 8
SETUP_SIGNING: Final = 256
"""The message that carries a signing key; it is neither stored nor forwarded (mavlink.io, "Message Signing")."""
_ID_2: Final = slice(7, 10)


def tlog_record(frame: bytes, utc_s: float) -> bytes:
    """One record: microseconds since 1970, big-endian, and the frame as it came."""
    return _TIME(round(utc_s * 1e6)) + frame


def is_secret(frame: bytes) -> bool:
    """Whether a MAVLink 2 frame carries a key; a MAVLink 1 frame cannot."""
    return frame[:1] == b"\xfd" and int.from_bytes(frame[_ID_2], "little") == SETUP_SIGNING
