"""A message as a log record, a JSON object, and back without loss.

The object holds the payload's own fields, Foxglove's beside them (`gloc3.log.foxglove.schemas`), and what JSON or the MCAP
record cannot carry: `_t_s`, the exact time of validity, and `_not_finite`, the numbers that are no numbers.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from operator import attrgetter
from typing import Any, Final, NamedTuple

import msgspec

from gloc3.log.foxglove.schemas import FoxgloveView, timestamp, view_of
from gloc3.log.json_schema import describe_type
from gloc3.log.pictures import pack_picture, unpack_picture
from gloc3.messages.envelope import Envelope, Message, Source
from gloc3.messages.vehicle import Image
from gloc3.messages.wire import wire_name

NOT_FINITE: Final = "_not_finite"
FROM: Final = "_from"
"""The publisher where it is not the channel's first one: platform, component, boot."""
FRAME: Final = "_frame"
"""The frame where it is not the channel's."""
PROBLEM: Final = "_problem"
"""Stands in the place of a payload that could not be written, with the reason."""


class _Extras(msgspec.Struct):
    """What a record has beside the payload's own fields."""

    t_s: float = msgspec.field(name="_t_s")
    not_finite: dict[str, str] = msgspec.field(name=NOT_FINITE, default_factory=dict)
    source: tuple[str, str, int] | None = msgspec.field(name=FROM, default=None)
    frame: str | None = msgspec.field(name=FRAME, default=None)


def _plain(value: Any) -> Any:
    """Converts types that msgspec does not support: arrays to lists, anything else to the name of its type."""
    to_list = getattr(value, "tolist", None)
    return to_list() if to_list is not None else f"<{type(value).__name__}>"


PACKED: Final[Mapping[type, tuple[Callable[[Any], Any], Callable[[Any], Any]]]] = {
    Image: (pack_picture, unpack_picture)
}
"""Types whose payloads are compressed in the log, and how: to the record and back. It takes milliseconds."""

_FROM_MARK: Final = b',"_from":['
_encode: Final = msgspec.json.Encoder(enc_hook=_plain).encode
_encode_sorted: Final = msgspec.json.Encoder(enc_hook=_plain, order="deterministic").encode
_decode_extras: Final = msgspec.json.Decoder(_Extras).decode


class PayloadEncoder:
    """Turns the payloads of one type into records."""

    __slots__ = ("_encode", "_nones", "_pack", "_separator", "_type", "view")

    def __init__(self, message_type: type[Message]) -> None:
        fields = msgspec.structs.fields(message_type)
        # The order of a set differs from process to process; `Any` may hold one.
        has_sets = any(word in str(field.type) for field in fields for word in ("Any", "set["))
        self._type = message_type
        self._encode = _encode_sorted if has_sets else _encode
        self._separator = b"," if fields else b""
        self._pack = PACKED[message_type][0] if message_type in PACKED else None
        self._nones = _counter_of_nones(tuple(field.name for field in fields if "None" in str(field.type)))
        self.view: Final[FoxgloveView | None] = view_of(message_type)

    @property
    def is_slow(self) -> bool:
        """Whether encoding takes so long that the control path must not wait for it."""
        return self._pack is not None

    @property
    def schema(self) -> tuple[str, bytes]:
        """Name and text of the records' JSON schema."""
        name = self.view.schema if self.view else f"gloc3.{wire_name(self._type.__name__)}"
        beside = {"_t_s": {"type": "number"}, **(self.view.properties if self.view else {})}
        return name, _encode(describe_type(self._type, name, beside))

    def encode(self, envelope: Envelope[Any], publish_ns: int, origin: bytes = b"") -> bytes:
        """The record of a message; a payload that cannot be written leaves the reason in its place.

        Args:
            envelope: the message.
            publish_ns: its time of validity in UTC.
            origin: what `origin` says of it.
        """
        payload = envelope.payload
        try:
            payload = payload if self._pack is None else self._pack(payload)
            data = self._encode(payload)
        except (TypeError, ValueError, OverflowError, RecursionError, msgspec.MsgspecError) as error:
            problem = _encode(f"{type(payload).__name__}: {error}")
            return b'{"_t_s":%b%b,"%b":%b}' % (_encode(envelope.t_s), origin, PROBLEM.encode(), problem)
        # JSON says null for NaN and infinity, too: are there more of them than fields that are None?
        is_finite = b"null" not in data or data.count(b"null") == self._nones(payload)
        view = self.view
        if view is None and is_finite:
            return b'{"_t_s":%b%b%b%b' % (_encode(envelope.t_s), origin, self._separator, data[1:])
        beside: dict[str, Any] = {}
        if view is not None:
            beside["timestamp"] = timestamp(publish_ns)
            beside.update(view.fields(envelope))
        if not is_finite and (found := dict(_not_finite(msgspec.to_builtins(payload, enc_hook=_plain)))):
            beside[NOT_FINITE] = found
        more = b"," + _encode(beside)[1:-1] if beside else b""
        return b'{"_t_s":%b%b%b%b%b' % (_encode(envelope.t_s), origin, more, self._separator, data[1:])


def origin(source: Source, frame: str, of_channel: Source, frame_of_channel: str) -> bytes:
    """What a record says of a publisher and frame that are not those of its channel; empty where they are."""
    found = b""
    if source != of_channel:
        found += b',"%b":%b' % (FROM.encode(), _encode((source.platform, source.component, source.boot)))
    if frame != frame_of_channel:
        found += b',"%b":%b' % (FRAME.encode(), _encode(frame))
    return found


def origin_in(record: bytes) -> bytes:
    """The publisher that a record names, as it stands there; empty for the channel's own."""
    begin = record.find(_FROM_MARK, 0, 48)
    return record[begin : record.find(b"]", begin)] if begin >= 0 else b""


def _counter_of_nones(names: tuple[str, ...]) -> Callable[[Message], int]:
    """How many of these fields of a message are None."""
    if len(names) > 1:
        get = attrgetter(*names)
        return lambda payload: get(payload).count(None)
    return lambda payload: sum(getattr(payload, name) is None for name in names)


class Restored(NamedTuple):
    """A record read back."""

    t_s: float
    payload: Any
    """The message, or a dictionary where its type is not known here or does not fit."""
    source: tuple[str, str, int] | None
    """Platform, component and boot of the publisher; None for the channel's."""
    frame: str | None
    """None for the channel's."""


class PayloadDecoder:
    """Turns the records of one channel back into messages of `message_type`, or into dictionaries."""

    def __init__(self, message_type: type[Message] | None, view_properties: tuple[str, ...] = ()) -> None:
        self._type = message_type
        self._decode = msgspec.json.Decoder(message_type).decode if message_type else None
        self._unpack = PACKED[message_type][1] if message_type is not None and message_type in PACKED else None
        self._beside = (NOT_FINITE, FROM, FRAME, "_t_s", *view_properties)

    def decode(self, data: bytes) -> Restored:
        """The message in a record.

        Raises:
            ValueError: it is no JSON object of this log.
        """
        extras = _decode_extras(data)
        origin = extras.source, extras.frame
        if self._decode is not None and not extras.not_finite:
            try:
                found = self._decode(data)
                return Restored(extras.t_s, found if self._unpack is None else self._unpack(found), *origin)
            except msgspec.ValidationError:
                pass
        values: dict[str, Any] = msgspec.json.decode(data)
        for path, text in extras.not_finite.items():
            _put(values, path, float(text))
        if self._type is not None:
            try:
                # Not strict, because JSON writes bytes as text and the keys of dictionaries, too.
                return Restored(extras.t_s, msgspec.convert(values, self._type, strict=False), *origin)
            except msgspec.ValidationError:
                pass
        shown = {name: value for name, value in values.items() if name not in self._beside}
        return Restored(extras.t_s, shown, *origin)


def _not_finite(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Path and text of the numbers in nested values that JSON cannot say."""
    if isinstance(value, float):
        if not math.isfinite(value):
            yield path, str(value)
    elif isinstance(value, dict | list | tuple):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inner in items:
            yield from _not_finite(inner, f"{path}\t{key}" if path else str(key))


def _put(values: Any, path: str, number: float) -> None:
    """Sets the value at a path; one that leads nowhere changes nothing."""
    *steps, last = path.split("\t")
    try:
        for step in steps:
            values = values[int(step) if isinstance(values, list) else step]
        values[int(last) if isinstance(values, list) else last] = number
    except (KeyError, IndexError, TypeError, ValueError):
        return
