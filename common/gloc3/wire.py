"""Messages as bytes: msgpack arrays with a type hash, the same on every middleware that leaves the process.

In memory a message is an object with names; on the wire it is an array, so that a row of status costs a few bytes.
Fields may be appended with defaults: a shorter array is filled up, a longer one is cut. What may not change is the
*fixed part*, the fields without default; its hash travels in `type`, and a mismatch is *versions differ*.
"""

import types
import typing
from enum import Enum
from functools import cache
from hashlib import blake2s
from typing import Any

import msgspec

from gloc3.errors import Gloc3Error, Misuse
from gloc3.messages import Envelope, Message, Source


class WireError(Gloc3Error):
    """Bytes from elsewhere that are no message; the text says why."""


class VersionsDiffer(WireError):
    """The other end knows this type with another fixed part."""


@cache
def type_name(message_type: type[Message]) -> str:
    """`Name#hash`, where the hash covers the names and types of the fields without default."""
    fixed = ",".join(
        f"{field.name}:{_spell(field.type)}" for field in msgspec.structs.fields(message_type) if field.required
    )
    return f"{message_type.__name__}#{blake2s(fixed.encode(), digest_size=3).hexdigest()}"


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
        inner = ",".join(f"{f.name}:{_spell(f.type)}" for f in msgspec.structs.fields(annotation) if f.required)
        return f"{annotation.__name__}({inner})"
    return getattr(annotation, "__name__", str(annotation))


class TypeRegistry:
    """The message types that a process knows, by name."""

    def __init__(self) -> None:
        self._types: dict[str, type[Message]] = {}

    def add(self, message_type: type[Message]) -> None:
        """Makes a type known. Two types of one name are a mistake of ours."""
        name = message_type.__name__
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
        source = envelope.source
        return msgspec.msgpack.encode(
            (
                envelope.topic,
                (source.platform, source.component, source.boot),
                envelope.sequence,
                envelope.t_s,
                envelope.frame,
                envelope.type,
                to_array(envelope.payload),
            )
        )

    def decode(self, data: bytes) -> Envelope[Any]:
        """The envelope in some bytes.

        Raises:
            WireError: the bytes are damaged, or of a type that is not known here.
        """
        try:
            parts = msgspec.msgpack.decode(data, type=_ENVELOPE)
        except (msgspec.DecodeError, msgspec.ValidationError, UnicodeDecodeError, RecursionError) as error:
            raise WireError(f"damaged envelope: {error}") from error
        topic, source, sequence, t_s, frame, type_text, payload = parts
        message = from_array(payload, self.find(type_text))
        return Envelope(topic, Source(*source), sequence, t_s, frame, type_text, message)


_ENVELOPE = tuple[str, tuple[str, str, int], int, float, str, str, list[Any]]


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
