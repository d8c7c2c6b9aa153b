"""MAVLink messages: one light class and one `Shape` for each message of a dialect."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, cast

import msgspec

from gloc3.errors import Misuse, nearest

_CODES = {
    "char": "s",
    "uint8_t": "B",
    "int8_t": "b",
    "uint16_t": "H",
    "int16_t": "h",
    "uint32_t": "I",
    "int32_t": "i",
    "uint64_t": "Q",
    "int64_t": "q",
    "float": "f",
    "double": "d",
}
_RESERVED = frozenset({"name", "id", "shape"})


class Address(NamedTuple):
    """Address of a sender or receiver: a MAVLink system and a component in it; 0 means all of them."""

    system: int
    component: int


class MavlinkMessage(msgspec.Struct, frozen=True, gc=False):
    """One decoded message; its fields are attributes, in the units of the MAVLink definition.

    Text is `str`, `uint8_t` arrays are `bytes`, other arrays are tuples. A field that is called `name` or `id` in the
    definition (as in STATUSTEXT) is reached as `name_` and `id_`.
    """

    name: ClassVar[str] = ""
    """The name in the definition, as "ATTITUDE"."""
    id: ClassVar[int] = -1
    """The number in the definition, as 30."""
    shape: ClassVar[MessageLayout]
    """Wire layout."""

    if TYPE_CHECKING:

        def __init__(self, *values: Any, **fields: Any) -> None: ...
        def __getattr__(self, field: str) -> Any: ...


class Field(NamedTuple):
    """One field of a message, in the order of the wire."""

    name: str
    type: str
    elements: int
    """Elements of an array; 0 for a single value."""

    @property
    def attribute(self) -> str:
        """The name under which Python reaches it."""
        return f"{self.name}_" if self.name in _RESERVED else self.name

    @property
    def code(self) -> str:
        """The code for `struct`; an array is one run of bytes."""
        if not self.elements:
            return _CODES[self.type]
        return f"{self.elements * struct.calcsize('<' + _CODES[self.type])}s"

    @property
    def default(self) -> Any:
        """Default value of an unset field: zero, as the protocol defines."""
        if self.type == "char":
            return ""
        if self.type == "uint8_t" and self.elements:
            return bytes(self.elements)
        zero: float = 0.0 if self.type in ("float", "double") else 0
        return (zero,) * self.elements if self.elements else zero


class MessageLayout:
    """Layout of one message's payload; encodes and decodes with one precompiled `struct`."""

    __slots__ = (
        "_pack",
        "_readers",
        "_unpack",
        "_writers",
        "crc_extra",
        "fields",
        "id",
        "instance",
        "message",
        "name",
        "size",
        "target_component_at",
        "target_system_at",
    )

    def __init__(
        self, name: str, number: int, crc_extra: int, fields: Sequence[Field], instance: str | None = None
    ) -> None:
        self.name = name
        self.id = number
        self.crc_extra = bytes([crc_extra])
        self.fields = tuple(fields)
        layout = struct.Struct("<" + "".join(field.code for field in fields))
        self.size = layout.size
        self._pack, self._unpack = layout.pack, layout.unpack_from
        arrays = [(index, field) for index, field in enumerate(fields) if field.elements]
        self._readers = tuple((index, reader) for index, field in arrays if (reader := _reader(field)) is not None)
        self._writers = tuple((index, _writer(name, field)) for index, field in arrays)
        self.target_system_at = self._offset("target_system", "target")
        self.target_component_at = self._offset("target_component")
        self.instance = self._slice(instance)
        """Where the payload says which of several senders of this message it is, such as a battery's number."""
        self.message = cast(
            "type[MavlinkMessage]",
            msgspec.defstruct(
                name,
                [(field.attribute, Any, field.default) for field in fields],
                bases=(MavlinkMessage,),
                namespace={"name": name, "id": number, "shape": self, "__doc__": f"MAVLink message {name}."},
                frozen=True,
                gc=False,
            ),
        )

    def make(self, fields: dict[str, Any]) -> MavlinkMessage:
        """A message with these fields; those left out are zero."""
        try:
            return self.message(**fields)
        except TypeError:
            known = [field.attribute for field in self.fields]
            for field in fields:
                if field not in known:
                    raise Misuse(f"{self.name} has no field {field!r}: {nearest(field, known)}") from None
            raise

    def decode(self, raw: bytes, start: int, length: int) -> MavlinkMessage:
        """The message in `raw[start : start + length]`; a shortened payload is filled up with zeros."""
        if length < self.size:
            values = self._unpack(raw[start : start + length].ljust(self.size, b"\0"))
        else:
            values = self._unpack(raw, start)
        if self._readers:
            changed = list(values)
            for index, read in self._readers:
                changed[index] = read(changed[index])
            return self.message(*changed)
        return self.message(*values)

    def encode(self, message: MavlinkMessage) -> bytes:
        """The payload of a message at full length."""
        values: Sequence[Any] = msgspec.structs.astuple(message)
        try:
            if self._writers:
                changed = list(values)
                for index, write in self._writers:
                    changed[index] = write(changed[index])
                values = changed
            return self._pack(*values)
        except (struct.error, OverflowError, TypeError, ValueError) as error:
            raise Misuse(self._explain(message)) from error

    def _offset(self, *names: str) -> int:
        """Where the byte with one of these names lies in the payload, or -1."""
        offset = 0
        for field in self.fields:
            if field.name in names and field.type == "uint8_t":
                return offset
            offset += struct.calcsize("<" + field.code)
        return -1

    def _slice(self, name: str | None) -> slice:
        """The bytes of a field in the payload; none without a name."""
        offset = 0
        for field in self.fields:
            size = struct.calcsize("<" + field.code)
            if field.name == name:
                return slice(offset, offset + size)
            offset += size
        return slice(0)

    def _explain(self, message: MavlinkMessage) -> str:
        """Which field could not be encoded."""
        writers = dict(self._writers)
        for index, field in enumerate(self.fields):
            value = getattr(message, field.attribute)
            try:
                struct.pack("<" + field.code, writers[index](value) if index in writers else value)
            except (struct.error, OverflowError, TypeError, ValueError) as error:
                return f"{self.name}.{field.name} ({field.type}) cannot hold {value!r}: {error}"
        return f"{self.name} cannot be encoded"


def _reader(field: Field) -> Callable[[bytes], Any] | None:
    """How an array's bytes become what Python sees; None where bytes stay bytes."""
    if field.type == "char":
        return lambda data: data.split(b"\0", 1)[0].decode("utf-8", "replace")
    if field.type == "uint8_t":
        return None
    return struct.Struct(f"<{field.elements}{_CODES[field.type]}").unpack


def _writer(message: str, field: Field) -> Callable[[Any], bytes]:
    """Encoder from Python values to an array's bytes; values that are too long are refused, short ones zero-filled."""
    count = field.elements
    if field.type in ("char", "uint8_t"):

        def write_bytes(value: Any) -> bytes:
            data = value.encode() if isinstance(value, str) else bytes(value)
            if len(data) > count:
                raise ValueError(f"{len(data)} bytes, {count} fit in {message}.{field.name}")
            return data

        return write_bytes
    pack = struct.Struct(f"<{count}{_CODES[field.type]}").pack
    zeros = (field.default[0],) * count

    def write_numbers(value: Any) -> bytes:
        return pack(*value, *zeros[len(value) :])

    return write_numbers
