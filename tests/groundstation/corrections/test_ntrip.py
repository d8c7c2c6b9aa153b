"""NTRIP without sockets: addresses, requests, answers of casters of both versions, source tables, GGA."""

from base64 import b64decode

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gloc3.errors import Refused
from gloc3.messages.frames import GeoPoint
from gloc3_groundstation.corrections.ntrip import (
    NtripReply,
    OldCaster,
    ReplyKind,
    gga,
    read_table,
    request,
    unknown_mountpoint,
)
from gloc3_groundstation.corrections.source_url import parse_source

SOURCE = parse_source("ntrip://me%40home.org:s%2Fcret:1@caster.example:2102/BASE")
TABLE = (
    b"CAS;caster.example;2101;x;y;0;DEU;50;8\r\n"
    b"STR;BASE;Town;RTCM 3.3;1005(1),1077(1);2;GPS;X;DEU;50.1;8.6;0;0;gen;none;B;N;9600;\r\n"
    b"STR;VRS;Net;RTCM 3.3;1005(1),1077(1);2;GPS;X;DEU;50.1;8.6;1;1;gen;none;B;N;9600;\r\n"
    b"ENDSOURCETABLE\r\n"
)


def test_an_address_is_read_and_never_shows_the_password() -> None:
    assert (SOURCE.host, SOURCE.port, SOURCE.mountpoint) == ("caster.example", 2102, "BASE")
    assert (SOURCE.user, SOURCE.password) == ("me@home.org", "s/cret:1")
    assert SOURCE.shown == "ntrip://caster.example:2102/BASE"
    assert "cret" not in f"{SOURCE!r} {SOURCE}"
    assert parse_source("ntrips://caster.example/BASE").port == 2102
    assert parse_source("ntrip://a@b.org:x@caster.example/BASE").user == "a@b.org"
    assert parse_source("tcp://[::1]:9000").host == "::1"
    assert parse_source("serial:///dev/ttyACM0:115200").shown == "serial:///dev/ttyACM0:115200"


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("caster:2101/BASE", "it has no scheme"),
        ("ntripx://u:secret@caster/BASE", "no scheme 'ntripx'; did you mean"),
        ("ntrip://u:secret@/BASE", "no host is named"),
        ("ntrip://u:secret@caster:port/BASE", "the host or the port is wrong"),
        ("ntrip://u:secret@caster:99999/BASE", "the host or the port is wrong"),
        ("ntrip://u:se%0D%0Acret@caster/BASE", "no others may be"),
        ("ntrip://u:secret@caster/BASE?x=1", "no others may be"),
        ("tcp://caster", "write tcp://HOST:PORT"),
        ("tcp://u:secret@caster:1", "write tcp://HOST:PORT"),
        ("serial:///dev/ttyACM0:fast", "no baud rate"),
        ("serial:///dev/ttyACM0:9600?key=x", "omit ?key="),
    ],
)
def test_a_wrong_address_is_refused_without_its_password(url: str, reason: str) -> None:
    with pytest.raises(Refused) as refusal:
        parse_source(url)
    assert reason in str(refusal.value)
    assert "cret" not in str(refusal.value)


def test_requests_of_both_versions() -> None:
    lines = request(SOURCE, "BASE", position="$GPGGA,x*00\r\n").decode().split("\r\n")
    assert lines[0] == "GET /BASE HTTP/1.1"
    assert lines[1].startswith("User-Agent: NTRIP ")
    assert {"Host: caster.example:2102", "Ntrip-Version: Ntrip/2.0", "Ntrip-GGA: $GPGGA,x*00"} <= set(lines)
    [secret] = [line.removeprefix("Authorization: Basic ") for line in lines if line.startswith("Auth")]
    assert b64decode(secret) == b"me@home.org:s/cret:1"
    assert lines[-2:] == ["", ""]
    first = request(SOURCE, "", version=1).decode()
    assert first.startswith("GET / HTTP/1.0\r\nUser-Agent: NTRIP ")
    assert "Ntrip-Version" not in first


ANSWERS = {
    "1": b"ICY 200 OK\r\n\r\n",
    "2": b"HTTP/1.1 200 OK\r\nNtrip-Version: Ntrip/2.0\r\nContent-Type: gnss/data\r\n\r\n",
    "2, in chunks": b"HTTP/1.1 200 OK\r\nContent-Type: gnss/data\r\nTransfer-Encoding: chunked\r\n\r\n",
    "table of 1": b"SOURCETABLE 200 OK\r\nServer: x\r\nContent-Type: text/plain\r\n\r\n",
    "table of 2": b"HTTP/1.1 200 OK\r\nContent-Type: gnss/sourcetable\r\n\r\n",
}


@pytest.mark.parametrize("name", ANSWERS)
@given(data=st.data())
def test_a_stream_is_read_in_any_pieces(name: str, data: st.DataObject) -> None:
    body, stream = bytes(range(256)) * 2, ANSWERS[name]
    if "chunks" in name:
        stream += b"3\r\n" + body[:3] + b"\r\nFd;x=y\r\n" + body[3:256] + b"\r\n100\r\n" + body[256:] + b"\r\n0\r\n\r\n"
    else:
        stream += body
    reply, found = NtripReply(SOURCE), b""
    while stream:
        size = data.draw(st.integers(1, 200))
        found += reply.receive(stream[:size])
        stream = stream[size:]
    assert found.lstrip(b"\r\n") == body
    assert reply.kind is (ReplyKind.TABLE if "table" in name else ReplyKind.DATA)


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (
            b"HTTP/1.1 401 Unauthorized\r\nWWW-Authenticate: Basic\r\n\r\n",
            "refuses the user or the password for 'BASE' (401)",
        ),
        (b"HTTP/1.0 401 Unauthorized\r\n\r\n", "(401)"),
        (b"ERROR - Bad Password\r\n", "refuses the user or the password"),
        (
            b"HTTP/1.1 404 Not Found\r\n\r\n",
            "no mountpoint 'BASE' at caster.example; did you mean 'BASF'? It has BASF, VRS",
        ),
        (b"HTTP/1.1 503 Busy\x1b[31m\r\n\r\n", "caster.example answers 'HTTP/1.1 503 Busy[31m'"),
    ],
)
def test_a_refusal_is_told_in_words(answer: bytes, reason: str) -> None:
    table = dict(zip(("BASF", "VRS"), read_table(TABLE).values(), strict=True))
    with pytest.raises(Refused) as refusal:
        NtripReply(SOURCE, table).receive(answer)
    assert reason in str(refusal.value)


@pytest.mark.parametrize(
    "answer", [b"HTTP/1.1 400 Bad Request\r\n\r\n", b"SSH-2.0-x\r\n", b"\xd3\x00\x13>", b"HTTP/" + b"x" * 20_000]
)
def test_an_answer_that_is_none_of_a_caster_s_is_tried_in_the_other_version(answer: bytes) -> None:
    with pytest.raises(OldCaster):
        NtripReply(SOURCE).receive(answer)


def test_a_chunk_without_a_length_is_refused() -> None:
    reply = NtripReply(SOURCE)
    with pytest.raises(Refused, match="chunk without a length"):
        reply.receive(ANSWERS["2, in chunks"] + b"xyz\r\n")
    with pytest.raises(Refused, match="chunk without a length"):
        NtripReply(SOURCE).receive(ANSWERS["2, in chunks"] + b"FFFFFFFFF\r\n")


def test_a_source_table_lists_mountpoints_and_which_want_a_position() -> None:
    table = read_table(TABLE)
    assert [(one.name, one.wants_position) for one in table.values()] == [("BASE", False), ("VRS", True)]
    many = {f"M{number}": table["VRS"] for number in range(30)}
    text = str(unknown_mountpoint(SOURCE, many))
    assert text.endswith("M10, M11 and 18 more")
    assert read_table(b"STR\r\nSTR;\x1b[2J;x\r\n\xff\xfe") == {}


def test_a_gga_sentence_has_position_time_and_checksum() -> None:
    text = gga(GeoPoint(-33.99999999, 8.5456, 488.04), 1_700_000_000.0)
    assert text.startswith("$GPGGA,221320.00,3400.0000,S,00832.7360,E,1,12,1.0,488.0,M,0.0,M,,*")
    check = 0
    for character in text[1:].partition("*")[0]:
        check ^= ord(character)
    assert text.endswith(f"*{check:02X}\r\n")
