"""Messages as bytes: msgpack arrays with a type hash, the same on every middleware that leaves the process.

In memory a message is an object with names; on the wire it is an array, so that a row of status costs a few bytes.
Fields may be appended with defaults: a shorter array is filled up, a longer one is truncated. The *fixed part*, the
fields without default, must not change; its hash is sent in `type`, and a mismatch is *versions differ*.

Names are part of that hash, and of logs. A renamed class keeps its former name (`FORMER_NAMES`), a field
by `msgspec.field(name="former name")`.
"""

import types
import typing
from collections.abc import Mapping
from enum import Enum
from functools import cache
from hashlib import blake2s
from typing import Any, Final

import msgspec

from gloc3.errors import UNREADABLE, Gloc3Error, Misuse
from gloc3.messages.envelope import Envelope, Message, Source


class WireError(Gloc3Error):
    """Bytes from elsewhere that are no message; the text says why."""


class VersionsDiffer(WireError):
    """The other end has a different fixed part of this type."""


FORMER_NAMES: Final[Mapping[str, str]] = {}
"""Name of a renamed class on the wire and in logs: its first released name, by the present one.

Applies to messages, the structures and enums in them, and the bodies of requests.
"""


def wire_name(class_name: str) -> str:
    """Name of a class on the wire and in logs."""
    return FORMER_NAMES.get(class_name, class_name)


@cache
def type_name(message_type: type[Message]) -> str:
    """`Name#hash`, where the hash covers the names and types of the fields without default."""
    digest = blake2s(_fixed_part(message_type).encode(), digest_size=3).hexdigest()
    return f"{wire_name(message_type.__name__)}#{digest}"


def _fixed_part(struct: type[msgspec.Struct]) -> str:
    fields = msgspec.structs.fields(struct)
    return ",".join(f"{field.encode_name}:{_spell(field.type)}" for field in fields if field.required)


def _spell(annotation: Any) -> str:
    """A name for a type that is the same in every process and Python version."""
    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        return _spell(typing.get_args(annotation)[0])
    if origin in (typing.Union, types.UnionType):
        return "|".join(sorted(_spell(a) for a in typing.get_args(annotation)))
    if origin is not None:
        return f"{origin.__name__}[{','.join(_spell(a) for a in typing.get_args(annotation))}]"
    if isinstance(annotation, type) and issubclass(annotation, msgspec.Struct):
        return f"{wire_name(annotation.__name__)}({_fixed_part(annotation)})"
    return wire_name(getattr(annotation, "__name__", str(annotation)))


class TypeRegistry:
    """Message types that a process knows, by name."""

    def __init__(self) -> None:
        self._types: dict[str, type[Message]] = {}
        self._forms: dict[str, _Form] = {}
        """By `Name#hash`."""
        self._sources: dict[tuple[str, str, int], Source] = {}

    def add(self, message_type: type[Message]) -> None:
        """Adds a type. Two types of one name are a programming error."""
        name = wire_name(message_type.__name__)
        if self._types.setdefault(name, message_type) is not message_type:
            raise Misuse(f"two message types are called {name}")

    def __iter__(self) -> typing.Iterator[type[Message]]:
        return iter(self._types.values())

    def find(self, type_text: str) -> type[Message]:
        """The type for a `Name#hash`.

        Raises:
            VersionsDiffer: the name is known, with another fixed part.
            WireError: the name is not known.
        """
        name = type_text.partition("#")[0]
        found = self._types.get(name)
        if found is None:
            raise WireError(f"unknown message type {name!r}")
        if type_name(found) != type_text:
            raise VersionsDiffer(f"versions differ: {type_text} there, {type_name(found)} here")
        return found

    def encode(self, envelope: Envelope[Any]) -> bytes:
        """An envelope as msgpack."""
        return _encode(envelope, envelope.payload)

    def encode_apart(self, envelope: Envelope[Any]) -> tuple[bytes, bytes] | None:
        """An envelope as msgpack without its one field of many bytes, and these; None where it is not worth it."""
        message: Message = envelope.payload
        name = _form(type(message)).bulk
        if name is None:
            return None
        body: bytes = getattr(message, name)
        if len(body) < APART:
            return None
        return _encode(envelope, msgspec.structs.replace(message, **{name: b""})), body

    def decode(self, data: bytes, body: bytes | None = None) -> Envelope[Any]:
        """The envelope in some bytes.

        Args:
            data: what `encode` gave, or the first of what `encode_apart` gave.
            body: the second of that.

        Raises:
            WireError: the bytes are damaged, or of a type that is not known here.
        """
        try:
            topic, source, sequence, t_s, frame, type_text, payload = _ENVELOPE.decode(data)
        except UNREADABLE as error:
            raise WireError(f"damaged envelope: {error}") from error
        form = self._forms.get(type_text)
        if form is None:
            form = self._forms[type_text] = _form(self.find(type_text))
        message = form.read(payload)
        if body is not None:
            if form.bulk is None:
                raise WireError(f"{type_text} has no field of many bytes")
            message = msgspec.structs.replace(message, **{form.bulk: body})
        known = self._sources.get(source)
        if known is None:
            if len(self._sources) >= REMEMBERED_SOURCES:
                self._sources.clear()
            known = self._sources[source] = Source(*source)
        return Envelope(topic, known, sequence, t_s, frame, form.type_text, message)


APART: Final = 16_384
"""Size from which a field is sent separately from its message, bytes, so that it is copied less often."""
REMEMBERED_SOURCES: Final = 1000

_ENVELOPE = msgspec.msgpack.Decoder(tuple[str, tuple[str, str, int], int, float, str, str, msgspec.Raw])
_ENCODER = msgspec.msgpack.Encoder()


def _encode(envelope: Envelope[Any], message: Message) -> bytes:
    source = envelope.source
    return _ENCODER.encode(
        (
            envelope.topic,
            (source.platform, source.component, source.boot),
            envelope.sequence,
            envelope.t_s,
            envelope.frame,
            envelope.type,
            _form(type(message)).arrange(message),
        )
    )


class _Form:
    """How one type of message becomes an array and is read from one, made once a type."""

    def __init__(self, message_type: type[Message]) -> None:
        self.type_text = type_name(message_type)
        fields = msgspec.structs.fields(message_type)
        twin = _twin(message_type)
        bulky = [field.name for field in fields if field.type is bytes and field.required]
        self.bulk = bulky[0] if len(bulky) == 1 else None
        self._type = message_type
        self._twin = twin
        is_flat = not any(_holds_named(field.type) for field in fields)
        self._decoder = msgspec.msgpack.Decoder(_array_like(message_type) if is_flat else twin, strict=False)
        self.arrange = msgspec.structs.astuple if is_flat else self._convert
        """The message as something that is written as an array."""
        self._is_flat = is_flat

    def _convert(self, message: Message) -> Any:
        return msgspec.convert(message, self._twin, from_attributes=True)

    def read(self, array: bytes | msgspec.Raw) -> Any:
        """The message in a msgpack array.

        Raises:
            WireError: the array does not fit the type.
        """
        try:
            found = self._decoder.decode(array)
            if self._is_flat:
                msgspec.structs.force_setattr(found, "__class__", self._type)
                return found
            return msgspec.convert(found, self._type, from_attributes=True)
        except UNREADABLE as error:
            raise WireError(f"{self._type.__name__}: {error}") from error


def _array_like(message_type: type[Message]) -> type[Message]:
    """The same type, read from arrays; changing the class of a result makes it an instance of the original type."""
    if message_type.__struct_config__.array_like:
        return message_type
    made = msgspec.defstruct(
        message_type.__name__, [], bases=(message_type,), array_like=True, frozen=True, kw_only=True, gc=False
    )
    assert issubclass(made, message_type)
    return made


@cache
def _form(message_type: type[Message]) -> _Form:
    return _Form(message_type)


def _holds_named(annotation: Any) -> bool:
    """Whether a structure that is written with names, and so has a twin, is somewhere in a type."""
    if isinstance(annotation, type) and issubclass(annotation, msgspec.Struct):
        return _twin(annotation) is not annotation
    return any(_holds_named(argument) for argument in typing.get_args(annotation))


def to_array(message: Message) -> Any:
    """A message as nested arrays, ready for msgpack."""
    return msgspec.to_builtins(
        msgspec.convert(message, _twin(type(message)), from_attributes=True), builtin_types=(bytes,)
    )


def from_array(array: Any, message_type: type[Message]) -> Any:
    """A message of `message_type` from nested arrays; fields that the array lacks take their defaults.

    Raises:
        WireError: the array does not fit the type.
    """
    try:
        twin = msgspec.convert(array, _twin(message_type), strict=False)
        return msgspec.convert(twin, message_type, from_attributes=True)
    except (msgspec.ValidationError, RecursionError) as error:
        raise WireError(f"{message_type.__name__}: {error}") from error


@cache
def _twin(struct: type[msgspec.Struct]) -> type[msgspec.Struct]:
    """The same structure with arrays instead of names, made once a type."""
    if struct.__struct_config__.array_like:
        return struct
    fields: list[Any] = []
    for field in msgspec.structs.fields(struct):
        annotation = _twin_type(field.type)
        if field.default_factory is not msgspec.NODEFAULT:
            fields.append((field.name, annotation, msgspec.field(default_factory=field.default_factory)))
        elif field.default is not msgspec.NODEFAULT:
            fields.append((field.name, annotation, field.default))
        else:
            fields.append((field.name, annotation))
    tag = struct.__struct_config__.tag
    return msgspec.defstruct(struct.__name__, fields, array_like=True, frozen=True, kw_only=True, tag=tag)


def _twin_type(annotation: Any) -> Any:
    if isinstance(annotation, type) and issubclass(annotation, msgspec.Struct):
        return _twin(annotation)
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is None or origin is typing.Literal or (isinstance(annotation, type) and issubclass(annotation, Enum)):
        return annotation
    if origin is typing.Annotated:
        return typing.Annotated[(_twin_type(arguments[0]), *arguments[1:])]
    if origin in (typing.Union, types.UnionType):
        return typing.Union[tuple(_twin_type(a) for a in arguments)]  # noqa: UP007 - built from a tuple at run time
    return origin[tuple(a if a is Ellipsis else _twin_type(a) for a in arguments)]
