"""Messages and fields that the installed library lacks: on the wire as MAVLink's own generator has them."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as theirs

from gloc3.mavlink import codec, upstream
from gloc3.mavlink.message import Address

GENERATED = {
    "COMMAND_CANCEL": (80, 4, 14),
    "COMPONENT_INFORMATION": (395, 212, 0),
    "COMPONENT_METADATA": (397, 108, 182),
    "EVENT": (410, 53, 160),
    "CURRENT_EVENT_SEQUENCE": (411, 3, 106),
    "REQUEST_EVENT": (412, 6, 33),
    "RESPONSE_EVENT_ERROR": (413, 7, 77),
    "CONTROL_STATUS": (512, 12, 21),
}
"""Number, bytes and CRC_EXTRA in the C library that mavgen makes of the same definitions."""


@pytest.mark.parametrize("name", GENERATED)
def test_they_are_as_the_generator_makes_them(name: str) -> None:
    shape = codec.shape(name)
    assert (shape.id, shape.size, shape.crc_extra[0]) == GENERATED[name]
    assert codec.name_of(shape.id) == name
    assert set(upstream.NUMBERS) == set(GENERATED)


def test_the_checksums_seed_is_right_for_every_message_of_the_library() -> None:
    for kind in theirs.mavlink_map.values():
        own = {"PARAM_VALUE", "PARAM_SET"}  # whose value we take as bits
        fields = [
            field._replace(type="float") if kind.msgname in own and field.name == "param_value" else field
            for field in codec.shape(kind.msgname).fields
        ]
        seeds = [upstream.crc_extra(kind.msgname, fields[:count]) for count in range(1, len(fields) + 1)]
        assert kind.crc_extra in seeds, kind.msgname  # the fields behind are extensions


def test_one_crosses_the_wire_and_is_addressed() -> None:
    cancel = codec.message("COMMAND_CANCEL", target_system=1, target_component=191, command=300)
    (frame,) = codec.Parser().receive(codec.Encoder(255, 190).encode(cancel))
    assert (frame.target_system, frame.target_component) == (1, 191)
    assert frame.decode() == cancel


@pytest.mark.parametrize("name", upstream.EXTENSIONS)
def test_who_does_not_know_an_added_field_reads_the_rest(name: str) -> None:
    added = {field.name: 0xBE if field.type == "uint8_t" else 0xDEAD_BEEF for field in upstream.EXTENSIONS[name]}
    known = {"mission_type": 1} if name in ("MISSION_COUNT", "MISSION_ACK") else {}
    if name == "SERIAL_CONTROL":
        known["count"] = 1
    reported = codec.message(name, **known, **added)
    raw = codec.Encoder(*Address(1, 191)).encode(reported)
    (frame,) = codec.Parser().receive(raw)
    assert frame.decode() == reported
    read = theirs.MAVLink(None).decode(bytearray(raw))
    assert read.get_type() == name
    assert {field: getattr(read, field) for field in known} == known
