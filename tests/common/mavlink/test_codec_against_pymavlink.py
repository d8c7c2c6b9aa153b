"""Our codec against pymavlink's own, for every message of the dialect."""

import math
import random
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as theirs

from gloc3.mavlink import codec, upstream
from gloc3.mavlink.message import Field, MavlinkMessage

pytestmark = pytest.mark.thorough

MESSAGES = sorted(kind.msgname for kind in theirs.mavlink_map.values())
_BITS = {
    "uint8_t": 8,
    "uint16_t": 16,
    "uint32_t": 32,
    "uint64_t": 64,
    "int8_t": 8,
    "int16_t": 16,
    "int32_t": 32,
    "int64_t": 64,
}


def single(chance: random.Random, kind: str) -> Any:
    if kind in ("float", "double"):
        return chance.choice([0.0, math.nan, math.inf, -1.5, chance.randrange(-(2**20), 2**20) / 64])
    bits = _BITS[kind]
    low = 0 if kind.startswith("u") else -(2 ** (bits - 1))
    return chance.choice([0, low, low + 2**bits - 1, chance.randrange(low, low + 2**bits)])


def value(chance: random.Random, field: Field) -> object:
    if field.type == "char":
        return "".join(chance.choices("ABCDEFGHIJ_0123456789", k=chance.randrange(field.elements + 1)))
    if not field.elements:
        return single(chance, field.type)
    values = [single(chance, field.type) for _ in range(field.elements)]
    if chance.random() < 0.3:
        values[field.elements // 2 :] = [0] * (field.elements - field.elements // 2)
    return bytes(int(v) for v in values) if field.type == "uint8_t" else tuple(values)


def their_message(name: str, fields: dict[str, object]) -> theirs.MAVLink_message:
    kind = getattr(theirs, f"MAVLink_{name.lower()}_message")
    converted = {k: v.encode() if isinstance(v, str) else v for k, v in fields.items()}
    return kind(**converted)


def both(name: str, seed: int) -> tuple[MavlinkMessage, theirs.MAVLink_message]:
    chance = random.Random(f"{name} {seed}")
    added = upstream.EXTENSIONS.get(name, ())
    fields = {field.name: value(chance, field) for field in codec.shape(name).fields if field not in added}
    if name in ("PARAM_VALUE", "PARAM_SET"):  # ours has the bits, theirs the float
        bits = chance.getrandbits(30)
        fields["param_value"] = bits
        theirs_value = struct.unpack("<f", struct.pack("<I", bits))[0]
        return codec.message(name, **fields), their_message(name, fields | {"param_value": theirs_value})
    ours = codec.message(name, **{f"{k}_" if k in ("name", "id") else k: v for k, v in fields.items()})
    return ours, their_message(name, fields)


def plain(value: object, field: str = "") -> object:
    if field == "param_value" and isinstance(value, float):
        return struct.unpack("<I", struct.pack("<f", value))[0]
    if isinstance(value, bytes | list | tuple):
        return [plain(v) for v in value]
    return "nan" if isinstance(value, float) and math.isnan(value) else value


@pytest.mark.parametrize("seed", range(3))
def test_every_message_gives_the_same_bytes_and_reads_the_same_back(seed: int) -> None:
    assert len(MESSAGES) > 250
    sender = theirs.MAVLink(None, srcSystem=7, srcComponent=191)
    encoder, parser = codec.Encoder(7, 191), codec.Parser()
    for name in MESSAGES:
        ours, other = both(name, seed)
        raw = encoder.encode(ours)
        assert raw == other.pack(sender), name
        sender.seq = (sender.seq + 1) % 256
        (frame,) = parser.receive(raw)
        decoded = frame.decode()
        assert decoded is not None
        assert (decoded.name, decoded.id, frame.sender) == (name, other.get_msgId(), (7, 191))
        read = theirs.MAVLink(None).decode(bytearray(raw))
        for field in (one for one in codec.shape(name).fields if hasattr(read, one.name)):
            assert plain(getattr(decoded, field.attribute)) == plain(getattr(read, field.name), field.name), (
                name,
                field.name,
            )
            assert plain(getattr(decoded, field.attribute)) == plain(getattr(ours, field.attribute)), (name, field.name)


def test_mavlink_1_frames_of_every_message_are_read() -> None:
    sender = theirs.MAVLink(None, srcSystem=1, srcComponent=1)
    parser = codec.Parser()
    for name in MESSAGES:
        _, other = both(name, 0)
        if other.get_msgId() > 255:
            continue
        raw = other.pack(sender, force_mavlink1=True)
        if len(raw) > 263:
            continue
        (frame,) = parser.receive(raw)
        assert (frame.message_id, frame.raw, frame.sender) == (other.get_msgId(), raw, (1, 1))
        decoded = frame.decode()
        assert decoded is not None
        for field in (one for one in codec.shape(name).fields if one not in upstream.EXTENSIONS.get(name, ())):
            read = getattr(theirs.MAVLink(None).decode(bytearray(raw)), field.name)
            assert plain(getattr(decoded, field.attribute)) == plain(read, field.name), name


def test_addresses_are_read_from_the_header_of_every_addressed_message() -> None:
    encoder, parser = codec.Encoder(255, 190), codec.Parser()
    for name in MESSAGES:
        names = {field.name for field in codec.shape(name).fields}
        if "target_system" in names:
            both_fields = {key: 9 for key in ("target_system", "target_component") if key in names}
            (frame,) = parser.receive(encoder.encode(codec.message(name, **both_fields)))
            assert frame.target_system == 9
            assert frame.target_component == (9 if "target_component" in names else 0)


def test_a_signed_frame_is_flagged_and_kept_as_it_came() -> None:
    sender = theirs.MAVLink(None, srcSystem=3, srcComponent=1)
    sender.signing.secret_key = bytes(range(32))
    sender.signing.sign_outgoing = True
    sender.signing.timestamp = 1
    raw = their_message("ATTITUDE", {f.name: 1 for f in codec.shape("ATTITUDE").fields}).pack(sender)
    good = codec.Encoder(1, 1).encode(codec.message("HEARTBEAT", type=2))
    first, second = codec.Parser().receive(raw + good)
    assert first.is_signed
    assert first.raw == raw
    assert first.decode() == codec.message("ATTITUDE", **{f.name: 1 for f in codec.shape("ATTITUDE").fields})
    assert second.raw == good
    assert not second.is_signed
