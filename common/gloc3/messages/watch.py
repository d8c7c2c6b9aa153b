"""Topics watched by stations: requests for samples, and the samples that the platform sends (DESIGN §7).

A station lists all topics that it wants in one `Watch` request and repeats it while they are displayed; without a
repeat the request expires after `LEASE_S`. A sample is the latest message of a topic, at the requested rate as far as
the link allows.
"""

from typing import Any, Final

import msgspec

from gloc3.errors import UNREADABLE
from gloc3.messages.envelope import Envelope, Message, Source
from gloc3.messages.wire import TypeRegistry, WireError, from_array, to_array, type_name

WATCH: Final = "watch/"
"""Prefix of topics, below the platform's name, that are sent only while a station watches."""
SAMPLES: Final = f"{WATCH}sample/"
LARGE: Final = f"{WATCH}large/"
ACTIVITY: Final = f"{WATCH}activity"

LEASE_S: Final = 8.0
"""Time after which a station's watch request expires, s."""
RENEW_S: Final = 3.0
"""Period of repeated watch requests, s: one of three may be delayed."""
LARGEST: Final = 48_000
"""Bytes of a sample."""


class Want(msgspec.Struct, frozen=True, array_like=True):
    """A watched topic; values out of range are clamped onboard."""

    topic: str
    """Below the platform's name."""
    rate_hz: float = 1.0
    """Samples a second, at most."""
    width: int = 64
    """Of images: the preview is scaled down to fit."""
    height: int = 48
    quality: int = 40
    """Of images: how much the compression keeps, 1 to 100."""


class TopicEntry(msgspec.Struct, frozen=True, array_like=True):
    """A topic that can be watched."""

    name: str
    """Below the platform's name."""
    type: str
    """The message's type, without its hash."""
    rate_hz: float
    """Nominal; 0 for event topics."""
    source: str
    """The component."""


class Sample(Message, frozen=True):
    """Latest message of a watched topic, with its time of validity.

    It is sent on `watch/sample/TOPIC`; one that needs more than a few frames, such as a picture, on
    `watch/large/TOPIC`.
    """

    type: str
    """`Name#hash` of the message; that of `Preview` in place of an image."""
    component: str
    boot: int
    sequence: int
    frame: str
    rate_hz: float
    """Rate of the topic, as measured on the platform."""
    payload: bytes
    """The message in wire format; empty where it cannot be sent."""
    problem: str = ""
    """Why it cannot be sent."""
    stations: tuple[str, ...] = ()
    """Stations that watch it."""


class Preview(Message, frozen=True):
    """An image made small."""

    camera: str
    width: int
    height: int
    full_width: int
    full_height: int
    data: bytes
    """8-bit grey values, or colours where the camera has them, compressed (WebP); empty where there is no picture."""
    is_valid: bool = True
    reason: str = ""


class TopicActivity(Message, frozen=True):
    """Activity of the topics of the platform's list, in its order; while somebody watches the list."""

    rates: list[int]
    """Messages in ten seconds."""
    ages: list[int]
    """Tenths of a second since the last message; -1 for none since the list was opened."""
    stations: tuple[str, ...] = ()
    """Stations that display the list."""


def pack(envelope: Envelope[Any], message: Message, rate_hz: float, stations: tuple[str, ...] = ()) -> Sample:
    """Packs a sample of a topic.

    Args:
        envelope: the topic's latest.
        message: the message to send: its payload, or a substitute.
        rate_hz: rate of the topic.
        stations: stations that watch it.
    """
    payload, problem = b"", ""
    try:
        payload = msgspec.msgpack.encode(to_array(message))
    except (TypeError, ValueError, OverflowError, RecursionError, msgspec.MsgspecError) as error:
        problem = f"it cannot be sent: {error}"
    if len(payload) > LARGEST:
        payload, problem = b"", f"it is too large to be sent: {len(payload)} bytes"
    source = envelope.source
    return Sample(
        type=type_name(type(message)),
        component=source.component,
        boot=source.boot,
        sequence=envelope.sequence,
        frame=envelope.frame,
        rate_hz=round(rate_hz, 1),
        payload=payload,
        problem=problem,
        stations=stations,
    )


def unpack(envelope: Envelope[Sample], types: TypeRegistry) -> Envelope[Any]:
    """Unpacks the watched message, as published on its own topic.

    Raises:
        WireError: it cannot be decoded here, or could not be sent; the text gives the reason.
    """
    sample = envelope.payload
    if sample.problem:
        raise WireError(sample.problem)
    message_type = Preview if sample.type == type_name(Preview) else types.find(sample.type)
    try:
        array = msgspec.msgpack.decode(sample.payload)
    except UNREADABLE as error:
        raise WireError(f"damaged sample: {error}") from error
    platform, _, name = envelope.topic.partition("/")
    topic = f"{platform}/{topic_of(name)}"
    source = Source(platform, sample.component, sample.boot)
    return Envelope(
        topic, source, sample.sequence, envelope.t_s, sample.frame, sample.type, from_array(array, message_type)
    )


def topic_of(name: str) -> str:
    """The topic watched on `watch/...`, below the platform's name."""
    return name.removeprefix(SAMPLES).removeprefix(LARGE)
