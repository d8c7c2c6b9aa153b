"""Messages and extension fields of MAVLink's definitions that the installed library lacks.

Written from mavlink/mavlink, `common.xml` and `development.xml` of 2026-07. Definitions that a later version of the
library contains have to be removed here.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

from fastcrc.crc16 import mcrf4xx as checksum

from gloc3.mavlink.message import Field, MessageLayout

_BYTE: Final = "uint8_t"
_TARGET: Final = (Field("target_system", _BYTE, 0), Field("target_component", _BYTE, 0))

_MESSAGES: Final[dict[str, tuple[int, tuple[Field, ...]]]] = {
    "COMMAND_CANCEL": (80, (*_TARGET, Field("command", "uint16_t", 0))),
    "COMPONENT_INFORMATION": (
        395,
        (
            Field("time_boot_ms", "uint32_t", 0),
            Field("general_metadata_file_crc", "uint32_t", 0),
            Field("general_metadata_uri", "char", 100),
            Field("peripherals_metadata_file_crc", "uint32_t", 0),
            Field("peripherals_metadata_uri", "char", 100),
        ),
    ),
    "COMPONENT_METADATA": (
        397,
        (Field("time_boot_ms", "uint32_t", 0), Field("file_crc", "uint32_t", 0), Field("uri", "char", 100)),
    ),
    "EVENT": (
        410,
        (
            Field("destination_component", _BYTE, 0),
            Field("destination_system", _BYTE, 0),
            Field("id", "uint32_t", 0),
            Field("event_time_boot_ms", "uint32_t", 0),
            Field("sequence", "uint16_t", 0),
            Field("log_levels", _BYTE, 0),
            Field("arguments", _BYTE, 40),
        ),
    ),
    "CURRENT_EVENT_SEQUENCE": (411, (Field("sequence", "uint16_t", 0), Field("flags", _BYTE, 0))),
    "REQUEST_EVENT": (
        412,
        (*_TARGET, Field("first_sequence", "uint16_t", 0), Field("last_sequence", "uint16_t", 0)),
    ),
    "RESPONSE_EVENT_ERROR": (
        413,
        (
            *_TARGET,
            Field("sequence", "uint16_t", 0),
            Field("sequence_oldest_available", "uint16_t", 0),
            Field("reason", _BYTE, 0),
        ),
    ),
    "CONTROL_STATUS": (512, (Field("flags", _BYTE, 0), Field("gcs_main", _BYTE, 0), Field("gcs_secondary", _BYTE, 10))),
}
"""Name to number and fields, in the order of the definition."""

EXTENSIONS: Final[dict[str, tuple[Field, ...]]] = {
    "MISSION_CURRENT": tuple(Field(name, "uint32_t", 0) for name in ("mission_id", "fence_id", "rally_points_id")),
    "MISSION_COUNT": (Field("opaque_id", "uint32_t", 0),),
    "MISSION_ACK": (Field("opaque_id", "uint32_t", 0),),
    "SERIAL_CONTROL": _TARGET,
}
"""Name to extension fields after those that the library has; receivers without them ignore them."""

NUMBERS: Final = {name: number for name, (number, _) in _MESSAGES.items()}
_NAMES: Final = {number: name for name, number in NUMBERS.items()}


def describe(number: int) -> MessageLayout | None:
    """Wire layout of the message with this number; None if it is not defined here either."""
    name = _NAMES.get(number)
    if name is None:
        return None
    fields = wire_order(_MESSAGES[name][1])
    return MessageLayout(name, number, crc_extra(name, fields), fields)


def wire_order(fields: Sequence[Field]) -> list[Field]:
    """Fields in wire order: the widest types first."""
    return sorted(fields, key=lambda field: -_width(field))


def crc_extra(name: str, fields: Sequence[Field]) -> int:
    """The byte by which two ends notice that their definitions differ (mavlink.io, "Serialization").

    Args:
        name: of the message.
        fields: in the order of the wire, without extensions.
    """
    text = f"{name} ".encode()
    for field in fields:
        text += f"{field.type} {field.name} ".encode() + (bytes([field.elements]) if field.elements else b"")
    found = checksum(text)
    return found & 0xFF ^ found >> 8


def _width(field: Field) -> int:
    """Bytes of one element."""
    one = field._replace(elements=0)
    return struct.calcsize("<" + one.code)
