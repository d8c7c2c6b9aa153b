"""Targets of what other processes and stations send: envelopes, the tunnel, the modem, streams of pictures."""

from typing import Final

import msgspec
from tests.fuzz.target import fuzz_target, pieces, refuses

from gloc3.camera.frame_stream import FrameError, FrameReader, read_stream_request
from gloc3.errors import UNREADABLE
from gloc3.exchange.acoustic import MOST_BYTES, AcousticCode
from gloc3.exchange.tunnel.endpoint import TunnelEndpoint
from gloc3.exchange.tunnel.frames import TunnelHello
from gloc3.exchange.tunnel.layout import MAX_PAYLOAD, PAYLOAD_TYPE, TunnelRole, seal
from gloc3.log.payloads import PayloadEncoder
from gloc3.mavlink.codec import message
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.messages.envelope import Envelope, Source
from gloc3.messages.topics import TopicTable
from gloc3.messages.watch import Sample, unpack
from gloc3.messages.wire import WireError, type_name

TOPICS: Final = TopicTable.installed()
TYPES: Final = sorted(TOPICS.types, key=lambda one: one.__name__)
BOOT: Final = 7
SENDERS: Final = (Address(255, 190), Address(254, 190), Address(1, 191), Address(3, 191))


@fuzz_target("gloc3.messages")
def zenoh_payload(data: bytes) -> None:
    """Any bytes are a message of a known type, which can be sent on, or are refused as damaged or of another version."""
    head, _, body = data.partition(b"\xff--")

    def whole(given: bytes | None) -> None:
        found = TOPICS.types.decode(head, given)
        assert isinstance(found.payload, TOPICS.types.find(found.type))
        TOPICS.types.encode(found)
        hash(found.topic)

    refuses(lambda: whole(None), WireError)
    refuses(lambda: whole(body), WireError)


@fuzz_target("gloc3.messages")
def message_of_any_type(data: bytes) -> None:
    """Whatever stands in the place of a message of a known type is such a message, or is refused."""
    if not data:
        return
    kind = TYPES[data[0] % len(TYPES)]
    head = msgspec.msgpack.encode(("p/t", ("p", "c", 1), 3, 1.5, "ned", type_name(kind), msgspec.Raw(data[1:])))

    def whole() -> None:
        found = TOPICS.types.decode(head)
        assert isinstance(found.payload, kind)
        PayloadEncoder(kind).encode(found, 0)

    refuses(whole, WireError)


@fuzz_target("gloc3.messages.watch", "gloc3.messages.wire")
def watched_sample(data: bytes) -> None:
    """A sample that a station gets of any topic is a message of a known type, or is refused."""

    def whole() -> None:
        sample = msgspec.msgpack.decode(data, type=Sample)
        envelope = Envelope("p/view", Source("p", "viewer", 1), 0, 0.0, "", type_name(Sample), sample)
        refuses(lambda: unpack(envelope, TOPICS.types), WireError)

    refuses(whole, *UNREADABLE)


def tunnel(payload: bytes) -> MavlinkMessage:
    """A TUNNEL message of ours."""
    return message("TUNNEL", payload_type=PAYLOAD_TYPE, payload_length=len(payload), payload=payload)


@fuzz_target("gloc3.exchange.tunnel", "gloc3.messages.wire")
def tunnel_frames(data: bytes) -> None:
    """Frames of anybody are counted and raise nothing; what is sent in answer stays within the link's budget."""
    for role in TunnelRole:
        is_platform = role is TunnelRole.PLATFORM
        own = Address(1, 191) if is_platform else Address(255, 190)
        endpoint = TunnelEndpoint(role, "pelican" if is_platform else "255", own, BOOT, TOPICS)
        other = TunnelRole.STATION if is_platform else TunnelRole.PLATFORM
        endpoint.receive(tunnel(TunnelHello(other, "pelican", 3, 0).encode(1)), Address(9, 9), 0.0)
        place, now_s = 0, 0.0
        while place + 2 <= len(data):
            head, length = data[place], data[place + 1] % MAX_PAYLOAD
            frame = data[place + 2 : place + 2 + length]
            place, now_s = place + 2 + length, now_s + 0.1
            payload = frame if head & 0x80 else seal(frame)[:MAX_PAYLOAD]
            endpoint.receive(tunnel(payload), SENDERS[head % len(SENDERS)], now_s)
            endpoint.tick(now_s)
            assert sum(len(sent) for _, _, sent in endpoint.outgoing(now_s)) <= 1000
            assert endpoint.next_tick_s() <= now_s + 1.0
            endpoint.events()


@fuzz_target("gloc3.exchange.acoustic")
def acoustic_modem(data: bytes) -> None:
    """A frame from the water is one of ours with its tag, or is counted as refused; none is longer than the modem's."""
    for key in (None, bytes(32)):
        code = AcousticCode("auv", key)
        found = code.decode(data)
        assert code.refused == (found is None)
        if found is not None:
            assert len(code.encode(found)) <= MOST_BYTES


@fuzz_target("gloc3.camera.frame_stream")
def frame_stream(data: bytes) -> None:
    """A stream of pictures and scans is cut into whole ones, or refused; what is waited for is bounded."""
    read_stream_request(data)
    reader, found = FrameReader(), list[object]()

    def whole() -> None:
        for piece in pieces(data, 61):
            found.extend(reader.receive(piece))

    refuses(whole, FrameError)
    assert len(found) <= len(data)
