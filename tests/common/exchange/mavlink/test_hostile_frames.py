"""Damaged, forged and foreign frames: counted, never an exception, and the honest transfer goes on."""

import asyncio
import zlib
from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
from tests.common.exchange.mavlink.ends import PLATFORM, RADIO_CONDITIONS, pair_on, standard_topics, text_of

from gloc3.clock import run_virtual
from gloc3.exchange.tunnel import frames
from gloc3.exchange.tunnel.endpoint import TunnelEndpoint
from gloc3.exchange.tunnel.frames import (
    CHUNK,
    Ack,
    Data,
    Echo,
    LaneReport,
    Refusal,
    Status,
    StatusPart,
    SummaryRows,
    TableRequest,
    TunnelFrame,
    TunnelHello,
    TunnelTable,
)
from gloc3.exchange.tunnel.layout import MAX_PAYLOAD, PAYLOAD_TYPE, VERSION, FrameKind, Lane, TunnelRole, seal
from gloc3.exchange.tunnel.outbox import EVERYBODY
from gloc3.exchange.tunnel.peers import MAKE_ROOM_AFTER_S, MAX_PEERS
from gloc3.exchange.tunnel.reader import ByteReader, unwrap, varint
from gloc3.mavlink.codec import message
from gloc3.mavlink.message import Address, MavlinkMessage
from gloc3.messages.command_interface import LoadMission, Steer, Verb

TOPICS = standard_topics()
STATION = Address(255, 190)
BOOT = 7

byte = st.integers(0, 0xFF)
word = st.integers(0, 0xFFFF)
small = st.integers(0, 300)
lane = st.sampled_from(Lane)
texts = st.text(max_size=20)
masks = st.none() | st.integers(1, 1 << 60)
bodies = st.binary(max_size=CHUNK - 4).map(lambda body: zlib.crc32(body).to_bytes(4, "little") + body)
chunks = st.binary(max_size=CHUNK) | st.binary(min_size=CHUNK, max_size=CHUNK) | bodies
hellos = st.builds(
    TunnelHello,
    st.sampled_from(TunnelRole),
    st.sampled_from(["255", "254", PLATFORM, "ü"]),
    word,
    st.integers(0, (1 << 48) - 1),
    st.lists(st.builds(Echo, byte, byte, st.integers(0, (1 << 32) - 1), word), max_size=3).map(tuple),
    st.lists(small, max_size=4).map(tuple),
)
reports = st.builds(LaneReport, lane, word, st.lists(st.tuples(st.integers(0, 15), masks), max_size=3).map(tuple))
any_frame: st.SearchStrategy[TunnelFrame] = st.one_of(
    hellos,
    st.builds(TunnelTable, st.binary(max_size=100)),
    st.builds(TableRequest, st.lists(small, max_size=20).map(tuple)),
    st.builds(Status, small, small, st.binary(max_size=100)),
    st.builds(StatusPart, small, small, byte, byte, word, st.binary(max_size=100)),
    st.builds(SummaryRows, small, small, st.binary(max_size=100)),
    st.builds(
        Data, st.just(BOOT) | word, lane, st.booleans(), st.integers(0, 31), st.integers(0, 5) | word, small | word,
        st.integers(0, 2) | word, st.integers(1, 3) | word, chunks,
    ),
    st.builds(Ack, st.just(BOOT) | word, word, word, st.just(0.04), st.lists(reports, max_size=2).map(tuple)),
    st.builds(Refusal, st.just(BOOT) | word, lane, word, texts),
)  # fmt: skip


def tunnel(payload: bytes, target: Address = EVERYBODY) -> MavlinkMessage:
    return message(
        "TUNNEL",
        target_system=target.system,
        target_component=target.component,
        payload_type=PAYLOAD_TYPE,
        payload_length=len(payload),
        payload=payload,
    )


@settings(max_examples=60)
@given(frame=any_frame, boot=st.integers(0, (1 << 32) - 1))
def test_every_frame_is_read_back_as_it_was_written(frame: TunnelFrame, boot: int) -> None:
    payload = frame.encode(boot)
    assert len(payload) <= MAX_PAYLOAD
    assert frames.decode(payload) == (boot, frame)


headers = st.builds(
    lambda kind, boot, rest: bytes((VERSION, kind)) + boot.to_bytes(4, "little") + rest,
    st.sampled_from(FrameKind) | byte,
    st.sampled_from([1, 2, BOOT]),
    st.binary(max_size=MAX_PAYLOAD - 10),
)
garbage = st.one_of(
    st.binary(max_size=MAX_PAYLOAD),
    headers,
    headers.map(seal),
    st.tuples(any_frame, st.sampled_from([1, 2])).map(lambda pair: pair[0].encode(pair[1])),
)
senders = st.sampled_from([STATION, Address(254, 190), Address(1, 191), Address(3, 191)])


@settings(max_examples=25)
@given(payloads=st.lists(st.tuples(garbage, senders), max_size=12), role=st.sampled_from(TunnelRole))
def test_garbage_is_counted_and_never_an_exception(payloads: list[tuple[bytes, Address]], role: TunnelRole) -> None:
    own = Address(1, 191) if role is TunnelRole.PLATFORM else STATION
    endpoint = TunnelEndpoint(role, PLATFORM if role is TunnelRole.PLATFORM else "255", own, BOOT, TOPICS)
    greeting = TunnelHello(
        TunnelRole.PLATFORM if role is TunnelRole.STATION else TunnelRole.STATION, PLATFORM, 3, 0
    ).encode(1)
    endpoint.receive(tunnel(greeting), Address(9, 9), 0.0)
    endpoint.receive(tunnel(greeting), Address(254, 190), 0.0)
    now_s = 0.0
    for payload, sender in payloads:
        now_s += 0.1
        endpoint.receive(tunnel(payload), sender, now_s)
        endpoint.tick(now_s)
        assert sum(len(sent) for _, _, sent in endpoint.outgoing(now_s)) <= 1000
        assert endpoint.next_tick_s() <= now_s + 1.0
    assert endpoint.counters.received_frames == len(payloads) + 2
    endpoint.events()


def test_a_length_beyond_the_frame_is_damage() -> None:
    endpoint = TunnelEndpoint(TunnelRole.STATION, "255", STATION, BOOT, TOPICS)
    endpoint.receive(message("TUNNEL", payload_type=PAYLOAD_TYPE, payload_length=200), Address(1, 191), 0.0)
    assert endpoint.counters.damaged == 1


def test_frames_of_others_are_left_alone() -> None:
    endpoint = TunnelEndpoint(TunnelRole.STATION, "255", STATION, BOOT, TOPICS)
    greeting = TunnelHello(TunnelRole.PLATFORM, PLATFORM, 0, 0).encode(1)
    endpoint.receive(tunnel(greeting, Address(254, 190)), Address(1, 191), 0.0)
    other_type = message("TUNNEL", payload_type=200, payload_length=3, payload=b"abc")
    endpoint.receive(other_type, Address(1, 191), 0.0)
    assert endpoint.counters.foreign == 2
    assert not endpoint.peers()


def test_strangers_take_no_more_than_the_table_of_peers() -> None:
    endpoint = TunnelEndpoint(TunnelRole.PLATFORM, PLATFORM, Address(1, 191), BOOT, TOPICS)
    for system in range(2, 2 + 2 * MAX_PEERS):
        endpoint.receive(
            tunnel(TunnelHello(TunnelRole.STATION, f"{system}", 0, 0).encode(system)), Address(system, 190), 0.0
        )
    assert len(endpoint.peers()) == MAX_PEERS
    assert endpoint.counters.too_many_peers == MAX_PEERS
    silent_s = MAKE_ROOM_AFTER_S + 1.0
    endpoint.tick(silent_s)
    endpoint.receive(tunnel(TunnelHello(TunnelRole.STATION, "255", 0, 0).encode(1)), STATION, silent_s)
    assert STATION in [peer.address for peer in endpoint.peers()]


def test_an_upload_survives_damaged_copies_of_its_own_frames_from_elsewhere() -> None:
    upload = LoadMission(name="m", text=text_of(4000, Random(1), is_random=True))

    async def fly() -> tuple[list[int], list[int]]:
        random = Random(2)
        station, platform, link = pair_on(2, RADIO_CONDITIONS)
        handle = platform.take

        def take_and_tamper(data: bytes) -> None:
            handle(data)
            for frame in (bytearray(data), bytearray(random.randbytes(len(data)))):
                frame[random.randrange(len(frame))] ^= 1 << random.randrange(8)
                handle(bytes(frame))  # MAVLink's check sum finds it

        link.b.on_data = take_and_tamper
        await asyncio.sleep(4.0)
        station.request(upload)
        station.request(Steer(verb=Verb.PAUSE))
        await asyncio.sleep(10.0)
        return platform.sequences(), station.acknowledged()

    given_to_platform, acknowledged = run_virtual(fly())
    assert sorted(given_to_platform) == sorted(acknowledged) == [0, 1]


@given(value=st.integers(0, (1 << 63) - 1))
def test_a_varint_is_read_back(value: int) -> None:
    assert ByteReader(varint(value)).varint() == value


@given(value=st.integers(0, 1 << 40), ahead=st.integers(-30_000, 30_000))
def test_a_number_cut_to_16_bits_is_found_again_near_the_last(value: int, ahead: int) -> None:
    number = max(0, value + ahead)
    assert unwrap(number & 0xFFFF, value) == number
