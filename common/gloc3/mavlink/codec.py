"""MAVLink codec: the only module that imports pymavlink, and only for the dialect's tables.

pymavlink's module takes 0.4 s to import, so it is imported when the first message is looked up, not with this file.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import Any, Final

from fastcrc.crc16 import mcrf4xx as checksum

from gloc3.errors import Misuse, nearest
from gloc3.mavlink import upstream
from gloc3.mavlink.message import Address, Field, MavlinkMessage, MessageLayout
from gloc3.mavlink.parser import HEADER_LENGTH, SIGNED, Frame, FrameParser
from gloc3.mavlink.signing import Signing

__all__ = [
    "Address",
    "Encoder",
    "Frame",
    "MavlinkMessage",
    "Parser",
    "decode",
    "enum_name",
    "enums",
    "message",
    "name_of",
    "shape",
]


_PARAMETER_IDS: Final = frozenset({22, 23})
"""PARAM_VALUE and PARAM_SET: `param_value` is an integer with the field's 32 bits. PX4 puts integers there, and some of
those are no float that survives being one; `gloc3.mavlink.services.parameter` reads and writes them."""


_INSTANCES: Final = {"ADSB_VEHICLE": "ICAO_address", "AIS_VESSEL": "MMSI"}
"""Fields by which senders of a message differ, where the dialect names none."""


@cache
def _dialect() -> Any:
    """ArduPilot's dialect, MAVLink 2 (it contains `common`)."""
    from pymavlink.dialects.v20 import ardupilotmega

    return ardupilotmega


def _describe(number: int) -> MessageLayout | None:
    """Builds the shape of one message from pymavlink's description of it."""
    kind = _dialect().mavlink_map.get(number)
    if kind is None:
        return upstream.describe(number)
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    if number in _PARAMETER_IDS:
        types["param_value"] = "uint32_t"
    columns = zip(kind.ordered_fieldnames, kind.array_lengths, strict=True)
    fields = [Field(name, types[name], count) for name, count in columns]
    fields += [field for field in upstream.EXTENSIONS.get(kind.msgname, ()) if field.name not in types]
    instance = _INSTANCES.get(kind.msgname, kind.instance_field)
    return MessageLayout(kind.msgname, number, kind.crc_extra, fields, instance)


class _Shapes(dict[int, MessageLayout | None]):
    """Shapes by message id, each built on first use; None for ids that the dialect does not define."""

    def __missing__(self, number: int) -> MessageLayout | None:
        shape = _describe(number)
        if shape is not None:  # unknown ids are not kept: a stranger could send 16 million of them
            self[number] = shape
        return shape


class _Names(dict[str, MessageLayout]):
    """Shapes by message name, each built when it is first needed."""

    def __missing__(self, name: str) -> MessageLayout:
        number = getattr(_dialect(), f"MAVLINK_MSG_ID_{name}", upstream.NUMBERS.get(name))
        found = None if number is None else _SHAPES[number]
        if found is None:
            known = [kind.msgname for kind in _dialect().mavlink_map.values()]
            raise Misuse(f"the dialect has no message {name!r}: {nearest(name, known)}")
        self[name] = found
        return found


_SHAPES: Final = _Shapes()
_NAMES: Final = _Names()


def shape(name: str) -> MessageLayout:
    """Wire layout of the message of this name."""
    return _NAMES[name]


def name_of(number: int) -> str:
    """Name of the message with this id; empty if the dialect does not define it."""
    found = _SHAPES[number]
    return "" if found is None else found.name


def message(name: str, /, **fields: Any) -> MavlinkMessage:
    """A message of this name; fields that are left out are zero.

    Raises:
        Misuse: no such message, or no such field; the text names the nearest.
    """
    try:
        return _NAMES[name].message(**fields)
    except TypeError:
        return _NAMES[name].make(fields)


def decode(frame: Frame) -> MavlinkMessage | None:
    """Decodes a frame; None for a message that the dialect does not define."""
    return frame.decode()


class Parser(FrameParser):
    """A parser for the dialect's messages; see `FrameParser`."""

    def __init__(self, *, is_datagram: bool = False) -> None:
        super().__init__(_SHAPES, is_datagram=is_datagram)


class Encoder:
    """Encodes messages of one component into frames, with sequence numbers.

    Args:
        system: of the sender.
        component: of the sender.
        signing: signs the frames, if given.
    """

    __slots__ = ("_component", "_sequence", "_system", "signing")

    _HEADER = struct.Struct("<BBBBBBHB").pack

    def __init__(self, system: int, component: int, signing: Signing | None = None) -> None:
        self._system = system
        self._component = component
        self.signing = signing
        """Signs the frames; may be changed at any time."""
        self._sequence = 0

    @property
    def address(self) -> Address:
        """Address of the sender."""
        return Address(self._system, self._component)

    def frame(self, message: MavlinkMessage) -> Frame:
        """A MAVLink 2 frame, with the trailing zeros of the payload cut off, as the parser of a receiver would find it.

        Raises:
            Misuse: a value does not fit its field; the text names the field.
        """
        shape = message.shape
        payload = shape.encode(message).rstrip(b"\0") or b"\0"
        sequence = self._sequence
        self._sequence = (sequence + 1) & 0xFF
        number, signing = shape.id, self.signing
        flags = 0 if signing is None else SIGNED
        body = (
            self._HEADER(len(payload), flags, 0, sequence, self._system, self._component, number & 0xFFFF, number >> 16)
            + payload
        )
        raw = b"\xfd%b%b" % (body, checksum(shape.crc_extra, checksum(body)).to_bytes(2, "little"))
        if signing is not None:
            raw = signing.sign(raw)
        return Frame(raw, self._system, self._component, sequence, number, flags, HEADER_LENGTH, len(payload), shape)

    def encode(self, message: MavlinkMessage) -> bytes:
        """The bytes of such a frame."""
        return self.frame(message).raw


class _Enums:
    """The dialect's enum values as attributes, as `enums.MAV_CMD_NAV_TAKEOFF`."""

    def __getattr__(self, name: str) -> int:
        value = getattr(_dialect(), name, None)
        if not isinstance(value, int):
            known = [known for known in vars(_dialect()) if known.startswith("MAV")]
            raise AttributeError(f"the dialect has no enum value {name!r}: {nearest(name, known)}")
        setattr(self, name, value)
        return value


enums: Final = _Enums()


def enum_name(enum: str, value: int) -> str:
    """The name of an enum's value, as "MAV_RESULT_FAILED" for `("MAV_RESULT", 4)`; the number if it has none."""
    entry = _dialect().enums.get(enum, {}).get(value)
    return str(value) if entry is None else str(entry.name)
