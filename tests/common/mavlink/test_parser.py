"""The parser on damaged, cut and foreign input: never an exception, never a good frame lost."""

import itertools
import struct
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.compatibility.released import transcript
from tests.data_folders import LINKS

from gloc3.mavlink import codec

_encoder = codec.Encoder(1, 1)
GOOD = [
    _encoder.encode(codec.message("HEARTBEAT", type=2, autopilot=12, mavlink_version=3)),
    _encoder.encode(codec.message("ATTITUDE", time_boot_ms=0xFDFE_FDFE, roll=0.5)),
    _encoder.encode(codec.message("TUNNEL", payload_type=0xC103, payload_length=4, payload=b"\xfd\xfe\xfd\0")),
    _encoder.encode(codec.message("STATUSTEXT", text="\u00fd hello")),
]


def unknown_frame(payload: bytes, message_id: int = 54321) -> bytes:
    body = struct.pack("<BBBBBBHB", len(payload), 0, 0, 7, 9, 1, message_id & 0xFFFF, message_id >> 16) + payload
    return b"\xfd" + body + b"\x12\x34"


def raws(frames: list[codec.Frame]) -> list[bytes]:
    return [frame.raw for frame in frames]


def known(frames: list[codec.Frame]) -> list[bytes]:
    return [frame.raw for frame in frames if frame.shape is not None]


def pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [data[a:b] for a, b in itertools.pairwise(edges)]


garbage = st.one_of(
    st.binary(max_size=60),
    st.lists(
        st.sampled_from([b"\xfd", b"\xfe", b"\0", b"\x1e", b"\x01", b"\xff", GOOD[0][:9], GOOD[1][:30]]), max_size=12
    ).map(b"".join),
    st.integers(0, 0xFFFFFF).flatmap(
        lambda number: st.binary(max_size=40).map(lambda data: unknown_frame(data, number))
    ),
)


@settings(max_examples=150)
@given(
    parts=st.lists(st.one_of(garbage, st.sampled_from(GOOD)), max_size=12),
    cuts=st.lists(st.integers(0, 4000), max_size=6),
)
def test_no_good_frame_is_lost_behind_garbage_and_every_byte_is_accounted_for(
    parts: list[bytes], cuts: list[int]
) -> None:
    stream = b"".join(parts) + bytes(300)  # quiet enough behind it to end every doubt
    parser = codec.Parser()
    frames = [frame for piece in pieces(stream, cuts) for frame in parser.receive(piece)]
    wanted = [part for part in parts if part in GOOD]
    found = known(frames)
    for raw in GOOD:
        assert found.count(raw) >= wanted.count(raw)
    assert sum(map(len, raws(frames))) + parser.bytes_dropped == len(stream)
    assert parser.frames_received == len(frames)
    for frame in frames:
        frame.decode()


@settings(max_examples=100)
@given(before=garbage, after=garbage, good=st.sampled_from(GOOD))
def test_a_datagram_gives_its_good_frame_whatever_is_around_it(before: bytes, after: bytes, good: bytes) -> None:
    parser = codec.Parser(is_datagram=True)
    assert good in known(parser.receive(before + good + after))
    assert raws(parser.receive(good)) == [good], "nothing is carried over from one datagram to the next"


@settings(max_examples=100)
@given(st.lists(st.binary(max_size=400), max_size=4))
def test_anything_at_all_is_survived(datagrams: list[bytes]) -> None:
    for parser in (codec.Parser(), codec.Parser(is_datagram=True)):
        for data in datagrams:
            for frame in parser.receive(data):
                frame.decode()


def test_frames_come_out_of_single_bytes() -> None:
    parser = codec.Parser()
    frames = [frame for raw in GOOD for byte in raw for frame in parser.receive(bytes([byte]))]
    assert raws(frames) == GOOD
    assert parser.bytes_dropped == 0


def test_an_unknown_message_is_kept_for_forwarding_and_never_decoded() -> None:
    raw = unknown_frame(b"something new")
    for parser in (codec.Parser(), codec.Parser(is_datagram=True)):
        first, second, third = parser.receive(GOOD[0] + raw + GOOD[1])
        assert second.raw == raw
        assert second.message_id == 54321
        assert (second.target_system, second.target_component) == (0, 0)
        assert second.decode() is None
        assert known([first, second, third]) == GOOD[:2]


def test_a_false_start_with_an_unknown_id_does_not_swallow_what_follows() -> None:
    false_start = bytes([0xFD, 200, 0, 0, 1, 2, 3, 0x99, 0x99, 0x99])
    parser = codec.Parser()
    assert raws(parser.receive(false_start + GOOD[0] * 12)) == [GOOD[0]] * 12
    assert parser.bytes_dropped == len(false_start)


def test_a_damaged_frame_costs_only_itself() -> None:
    damaged = bytearray(GOOD[1])
    damaged[12] ^= 0x40
    parser = codec.Parser(is_datagram=True)
    assert raws(parser.receive(GOOD[0] + bytes(damaged) + GOOD[2])) == [GOOD[0], GOOD[2]]
    assert parser.bytes_dropped == len(damaged)


def test_unknown_incompatibility_flags_are_dropped() -> None:
    strange = bytearray(GOOD[0])
    strange[2] = 0x02
    parser = codec.Parser(is_datagram=True)
    assert raws(parser.receive(bytes(strange) + GOOD[1])) == [GOOD[1]]


def packets(path: Path) -> list[bytes]:
    """The captured packets in the enhanced packet blocks of a pcapng file."""
    data, position, found = path.read_bytes(), 0, []
    while position + 12 <= len(data):
        kind, length = struct.unpack_from("<II", data, position)
        if kind == 6:
            (captured,) = struct.unpack_from("<I", data, position + 20)
            found.append(data[position + 28 : position + 28 + captured])
        position += length
    return found


def test_what_a_vehicle_and_a_station_of_our_own_have_said_is_read_whole() -> None:
    """The bytes of a link between two ends of version 0.1."""
    for sender in ("station", "platform"):
        parser, sent = codec.Parser(is_datagram=True), [piece.data for piece in transcript().sent_by(sender)]
        frames = [frame for data in sent for frame in parser.receive(data)]
        assert raws(frames) == sent
        assert {"HEARTBEAT", "TUNNEL"} <= {decoded.name for frame in frames if (decoded := frame.decode()) is not None}
        assert parser.bytes_dropped == 0


@given(st.lists(st.binary(max_size=40), min_size=1, max_size=8))
def test_older_framing_is_garbage_that_is_counted(payloads: list[bytes]) -> None:
    """MAVLink 0.9 begins a frame with 0x55, and has no seed in its check sum."""
    previous = b"".join(
        struct.pack("<BBBBBB", 0x55, len(payload), 0, 1, 1, 30) + payload + b"\x12\x34" for payload in payloads
    )
    parser = codec.Parser()
    frames = parser.receive(previous + GOOD[0] + bytes(300))
    assert GOOD[0] in raws(frames) or b"\xfd" in previous or b"\xfe" in previous
    assert parser.bytes_dropped + sum(map(len, raws(frames))) == len(previous + GOOD[0]) + 300


@pytest.mark.outside
@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("autopilot_version.pcapng", ["AUTOPILOT_VERSION"]),
        ("gps_raw_int.pcapng", ["GPS_RAW_INT"]),
        ("gps_global_origin.pcapng", ["GPS_GLOBAL_ORIGIN"]),
        ("mission_item_int.pcapng", ["MISSION_ITEM_INT"]),
        ("file_transfer_protocol.pcapng", ["FILE_TRANSFER_PROTOCOL"]),
        ("command_long_over_tcp.pcapng", ["COMMAND_LONG"]),
        ("common.pcapng", ["STATUSTEXT"]),
    ],
)
def test_captures_of_real_links_are_read(file: str, expected: list[str]) -> None:
    found = []
    for packet in packets(LINKS / file):
        frames = codec.Parser(is_datagram=True).receive(packet)
        found += [decoded.name for frame in frames if (decoded := frame.decode()) is not None]
    assert set(expected) <= set(found)


@pytest.mark.outside
def test_version_0_9_framing_is_garbage_that_is_counted() -> None:
    data = (LINKS / "v09_framing.mavlink").read_bytes()
    parser = codec.Parser()
    frames = parser.receive(data + bytes(300))
    assert known(frames) == []
    assert parser.bytes_dropped + sum(map(len, raws(frames))) == len(data) + 300
