"""A parameter, and the two encodings of integers in the protocol's float."""

from __future__ import annotations

import math
import struct
from enum import Enum, IntEnum
from typing import Final

import msgspec

from gloc3.errors import Refused

LONGEST_NAME: Final = 16


class ParameterType(IntEnum):
    """MAV_PARAM_TYPE; the 64-bit types do not fit the protocol's messages."""

    UINT8 = 1
    INT8 = 2
    UINT16 = 3
    INT16 = 4
    UINT32 = 5
    INT32 = 6
    REAL32 = 9


_CODES: Final = {
    ParameterType.UINT8: "B",
    ParameterType.INT8: "b",
    ParameterType.UINT16: "H",
    ParameterType.INT16: "h",
    ParameterType.UINT32: "I",
    ParameterType.INT32: "i",
    ParameterType.REAL32: "f",
}


class ParameterEncoding(Enum):
    """Encoding of an integer on the wire; reported by the capabilities in AUTOPILOT_VERSION."""

    BYTEWISE = "bytewise"
    """Its bytes in the float's place, as PX4 does."""
    CAST = "cast"
    """Its value as a float, as ArduPilot does; exact up to 2**24."""


class Parameter(msgspec.Struct, frozen=True):
    """A named value of a vehicle."""

    name: str
    value: float
    """A whole number for the integer types; for REAL32 a 32-bit float."""
    type: ParameterType = ParameterType.REAL32

    def to_bits(self, encoding: ParameterEncoding) -> int:
        """The 32 bits that PARAM_VALUE and PARAM_SET carry."""
        if self.type is ParameterType.REAL32 or encoding is ParameterEncoding.CAST:
            raw = struct.pack("<f", self.value)
        else:
            raw = struct.pack("<" + _CODES[self.type], int(self.value)).ljust(4, b"\0")
        return int.from_bytes(raw, "little")

    def is_same(self, other: Parameter) -> bool:
        """Whether both have the same value, as far as the protocol can represent it."""
        if self.type is ParameterType.REAL32 and math.isnan(self.value):
            return math.isnan(other.value)
        return self.value == other.value


def parameter(name: str, value: float, kind: ParameterType = ParameterType.REAL32) -> Parameter:
    """Creates a parameter whose value fits its type.

    Raises:
        Refused: the name is too long, or the value does not fit.
    """
    if not 0 < len(name.encode()) <= LONGEST_NAME:
        raise Refused(f"parameter {name!r}: a name has 1 to {LONGEST_NAME} characters")
    try:
        if kind is ParameterType.REAL32:
            return Parameter(name, struct.unpack("<f", struct.pack("<f", value))[0], kind)
        if value != int(value):
            raise Refused(f"parameter {name} is an integer ({kind.name}), {value} is none")
        struct.pack("<" + _CODES[kind], int(value))
    except (struct.error, OverflowError, ValueError):
        raise Refused(f"parameter {name} ({kind.name}) cannot be {value}") from None
    return Parameter(name, int(value), kind)


def read_parameter(name: str, bits: int, type_number: int, encoding: ParameterEncoding) -> Parameter | None:
    """What the fields of PARAM_VALUE or PARAM_SET say; None for types that no message can hold."""
    if type_number not in ParameterType._value2member_map_:
        return None
    kind = ParameterType(type_number)
    raw = bits.to_bytes(4, "little")
    if kind is ParameterType.REAL32:
        return Parameter(name, struct.unpack("<f", raw)[0], kind)
    if encoding is ParameterEncoding.BYTEWISE:
        return Parameter(name, struct.unpack_from("<" + _CODES[kind], raw)[0], kind)
    value = struct.unpack("<f", raw)[0]
    return Parameter(name, round(value), kind) if math.isfinite(value) else None
