"""The codec's own rules: what is filled in, what is refused, what is cheap."""

import math
import subprocess
import sys

import pytest
from fastcrc.crc16 import mcrf4xx as checksum

from gloc3.errors import Misuse
from gloc3.mavlink import codec
from gloc3.mavlink.signing import Signing


def test_fields_that_are_left_out_are_zero() -> None:
    text = codec.message("STATUSTEXT")
    assert (text.severity, text.text, text.id_, text.chunk_seq) == (0, "", 0, 0)
    odometry = codec.message("ODOMETRY")
    assert odometry.q == (0.0, 0.0, 0.0, 0.0)
    assert codec.message("TUNNEL").payload == bytes(128)


def test_a_message_has_its_name_and_number() -> None:
    attitude = codec.message("ATTITUDE", roll=0.5)
    assert (attitude.name, attitude.id, attitude.roll) == ("ATTITUDE", 30, 0.5)
    named = codec.message("NAMED_VALUE_FLOAT", name_="speed")
    assert (named.name, named.name_) == ("NAMED_VALUE_FLOAT", "speed")


def test_trailing_zeros_are_cut_but_one_byte_always_stays() -> None:
    encoder = codec.Encoder(1, 1)
    empty = encoder.encode(codec.message("ATTITUDE"))
    assert empty[1] == 1
    (frame,) = codec.Parser().receive(empty)
    assert frame.decode() == codec.message("ATTITUDE")


def test_sequence_numbers_count_and_wrap() -> None:
    encoder = codec.Encoder(1, 1)
    heartbeat = codec.message("HEARTBEAT")
    assert [encoder.encode(heartbeat)[4] for _ in range(257)] == [*range(256), 0]


def test_not_a_number_survives() -> None:
    raw = codec.Encoder(1, 1).encode(codec.message("COMMAND_LONG", param1=math.nan, param7=math.inf))
    (frame,) = codec.Parser().receive(raw)
    command = frame.decode()
    assert command is not None
    assert math.isnan(command.param1)
    assert command.param7 == math.inf


def test_extension_fields_travel_and_may_be_absent() -> None:
    encoder, parser = codec.Encoder(1, 1), codec.Parser()
    fence = codec.message("MISSION_COUNT", target_system=1, count=3, mission_type=1)
    (frame,) = parser.receive(encoder.encode(fence))
    assert frame.decode() == fence
    plain = codec.message("MISSION_COUNT", target_system=1, count=3)
    (frame,) = parser.receive(encoder.encode(plain))
    assert frame.length == 3
    assert frame.decode() == plain


def test_a_longer_payload_from_a_newer_dialect_is_still_read() -> None:
    shape = codec.shape("HEARTBEAT")
    body = bytes([9 + 4, 0, 0, 0, 1, 1, 0, 0, 0]) + bytes([0, 0, 0, 0, 2, 3, 4, 5, 3]) + b"news"
    crc = checksum(shape.crc_extra, checksum(body))
    (frame,) = codec.Parser().receive(b"\xfd" + body + crc.to_bytes(2, "little"))
    heartbeat = frame.decode()
    assert heartbeat is not None
    assert (heartbeat.type, heartbeat.autopilot, heartbeat.mavlink_version) == (2, 3, 3)


@pytest.mark.parametrize(
    ("name", "fields", "expected"),
    [
        ("ATITUDE", {}, "did you mean 'ATTITUDE'"),
        ("ATTITUDE", {"rol": 1.0}, "did you mean 'roll'"),
        ("STATUSTEXT", {"id": 1}, "id_"),
    ],
)
def test_unknown_names_are_refused_with_the_nearest(name: str, fields: dict[str, float], expected: str) -> None:
    with pytest.raises(Misuse, match=expected):
        codec.message(name, **fields)


@pytest.mark.parametrize(
    ("name", "fields", "field"),
    [
        ("HEARTBEAT", {"type": 256}, "HEARTBEAT.type"),
        ("HEARTBEAT", {"type": 1.5}, "HEARTBEAT.type"),
        ("ATTITUDE", {"roll": 1e300}, "ATTITUDE.roll"),
        ("ATTITUDE", {"roll": "level"}, "ATTITUDE.roll"),
        ("STATUSTEXT", {"text": "x" * 51}, "STATUSTEXT.text"),
        ("TUNNEL", {"payload": bytes(129)}, "TUNNEL.payload"),
        ("ODOMETRY", {"q": (1.0,) * 5}, "ODOMETRY.q"),
    ],
)
def test_a_value_that_does_not_fit_is_refused_by_field(name: str, fields: dict[str, object], field: str) -> None:
    with pytest.raises(Misuse, match=field):
        codec.Encoder(1, 1).encode(codec.message(name, **fields))


def test_short_arrays_are_filled_up_with_zeros() -> None:
    raw = codec.Encoder(1, 1).encode(codec.message("TUNNEL", payload=b"abc", payload_length=3))
    (frame,) = codec.Parser().receive(raw)
    tunnel = frame.decode()
    assert tunnel is not None
    assert tunnel.payload == b"abc" + bytes(125)


def test_text_that_is_not_utf8_does_not_break_reading() -> None:
    shape = codec.shape("STATUSTEXT")
    assert shape.decode(b"\x06\xff\xfeabc\0def", 0, 10).text == "��abc"


def test_enum_values_and_names() -> None:
    assert codec.enums.MAV_CMD_NAV_TAKEOFF == 22
    assert codec.enum_name("MAV_RESULT", 4) == "MAV_RESULT_FAILED"
    assert codec.enum_name("MAV_RESULT", 99) == "99"
    with pytest.raises(AttributeError, match="MAV_CMD_NAV_TAKEOFF"):
        assert codec.enums.MAV_CMD_NAV_TAKEOF


@pytest.mark.thorough
def test_importing_the_codec_does_not_import_pymavlink() -> None:
    code = "import sys, gloc3.mavlink.codec; sys.exit('pymavlink' in sys.modules)"
    environment = {"PYTHONPATH": ":".join(sys.path)}
    assert subprocess.run([sys.executable, "-c", code], env=environment, check=False).returncode == 0


@pytest.mark.parametrize("signing", [None, Signing(bytes(32), link_id=1, now=5)])
def test_an_encoded_frame_is_the_one_that_a_parser_finds_in_its_bytes(signing: Signing | None) -> None:
    encoder = codec.Encoder(1, 191, signing)
    for number in range(300):
        frame = encoder.frame(codec.message("COMMAND_LONG", target_system=7, command=number))
        assert codec.Parser().receive(frame.raw) == [frame]
