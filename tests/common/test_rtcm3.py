"""RTCM 3 frames are found among other bytes; damaged ones are counted once and dropped."""

from hypothesis import given
from hypothesis import strategies as st

from gloc3.messages.frames import GeoPoint, ecef_from_geo
from gloc3.rtcm3 import RtcmParser, crc24q, is_observation

from .rtcm_frames import SAMPLE_1005, base_position, observations


def test_the_example_of_the_standard_is_read() -> None:
    [frame] = RtcmParser().receive(SAMPLE_1005)
    assert frame.message_type == 1005
    assert frame.base_ecef_m() == (1114104.5999, -4850729.7108, 3975521.4643)
    assert not is_observation(1005)
    assert crc24q(b"123456789") == 0xCDE703, "the check value of CRC-24/LTE-A"


def test_a_position_that_is_not_on_earth_is_none() -> None:
    place = GeoPoint(-33.5, -70.25, 520.0)
    [frame] = RtcmParser().receive(base_position(place))
    found = frame.base_ecef_m()
    assert found is not None
    assert max(abs(a - b) for a, b in zip(found, ecef_from_geo(place), strict=True)) < 1e-4
    [nowhere] = RtcmParser().receive(base_position(GeoPoint(0.0, 0.0, 1e7)))
    assert nowhere.base_ecef_m() is None
    assert [one.base_ecef_m() for one in RtcmParser().receive(observations(4, 1006))] == [None]


@given(st.data())
def test_frames_come_whole_out_of_any_pieces_among_other_protocols(data: st.DataObject) -> None:
    frames = [SAMPLE_1005, observations(700), observations(2, 1230)]
    between = st.binary(max_size=30).map(lambda raw: raw.replace(b"\xd3", b"$"))
    stream = b"".join(data.draw(between) + frame for frame in frames)
    parser, found = RtcmParser(), []
    while stream:
        size = data.draw(st.integers(1, 300))
        found += parser.receive(stream[:size])
        stream = stream[size:]
    assert [frame.raw for frame in found] == frames
    assert parser.damaged == 0


def test_a_damaged_frame_is_counted_once_and_the_next_one_is_read() -> None:
    damaged = bytearray(observations(200))
    damaged[40:60] = b"\xd3\x00" * 10
    parser = RtcmParser()
    found = parser.receive(bytes(damaged) + SAMPLE_1005 + observations(50))
    assert [frame.message_type for frame in found] == [1005, 1077]
    assert parser.damaged == 1
    shortened = observations(200)[:-20]
    assert [frame.message_type for frame in parser.receive(shortened + SAMPLE_1005 + observations(50))] == [1005, 1077]
    assert parser.damaged == 2


@given(st.binary(max_size=400))
def test_any_bytes_are_borne(data: bytes) -> None:
    parser = RtcmParser()
    for frame in parser.receive(b"\xd3" + data):
        frame.base_ecef_m()
