"""What firmware says about its parameters is read from PX4's and ArduPilot's descriptions, packed or not."""

import lzma
from contextlib import suppress

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.errors import InputError
from gloc3_groundstation.services.descriptions import parameter_info
from gloc3_groundstation.services.descriptions.parameter_info import ParameterInfo, info_of, read_infos

PX4 = b"""{"version": 1, "parameters": [
 {"name": "NAV_DLL_ACT", "type": "Int32", "shortDesc": "Set data link loss failsafe mode", "group": "Mission",
  "default": 0, "min": 0, "max": 6, "values": [{"value": 0, "description": "Disabled"}, {"value": 1, "description": "Hold"}]},
 {"name": "EKF2_AID{n}", "type": "Int32", "shortDesc": "Aid {n}", "bitmask": [{"index": 0, "description": "GPS"}],
  "rebootRequired": true, "min": "x"},
 {"name": 5}, 7]}"""
ARDUPILOT_JSON = b"""{"json": {"version": 0}, "FS_": {"FS_GCS_ENABLE": {"DisplayName": "Ground Station Failsafe Enable",
 "Description": "what to do", "User": "Standard", "Values": {"0": "Disabled", "1": "RTL"}},
 "RTL_ALT": {"Range": {"low": "30", "high": "300000"}, "Units": "cm", "Increment": "1", "ReadOnly": "True"}}}"""
ARDUPILOT_XML = b"""<?xml version="1.0"?><paramfile><vehicles><parameters name="ArduCopter">
<param humanName="RTL Altitude" name="ArduCopter:RTL_ALT" documentation="how high">
<field name="Range">30 300000</field><field name="Units">cm</field><field name="RebootRequired">True</field></param>
<param humanName="Failsafe" name="FS_GCS_ENABLE"><values><value code="0">Disabled</value><value code="1">RTL</value></values></param>
<param humanName="Mask" name="MASK"><field name="Bitmask">0:A,1:B</field><bitmask><bit code="0">A</bit><bit code="1">B</bit></bitmask></param>
</parameters></vehicles></paramfile>"""


@pytest.mark.parametrize("pack", [bytes, lzma.compress])
def test_px4_is_read_packed_or_not(pack: type[bytes]) -> None:
    infos = read_infos(pack(PX4), "parameters.json")
    info = infos["NAV_DLL_ACT"]
    assert (info.minimum, info.maximum, info.default, info.group) == (0.0, 6.0, 0.0, "Mission")
    assert info.values == {0.0: "Disabled", 1.0: "Hold"}
    assert sorted(infos) == ["EKF2_AID{n}", "NAV_DLL_ACT"]


def test_a_description_that_stands_for_many_is_found_for_each() -> None:
    infos = read_infos(PX4, "p")
    found = info_of(infos, "EKF2_AID7")
    assert found is not None
    assert (found.title, found.bits, found.needs_restart, found.minimum) == ("Aid 7", {0: "GPS"}, True, None)
    assert info_of(infos, "EKF2_OTHER7") is None


@pytest.mark.parametrize("data", [ARDUPILOT_JSON, ARDUPILOT_XML])
def test_ardupilot_is_read_as_json_and_xml(data: bytes) -> None:
    infos = read_infos(data, "apm.pdef")
    assert (infos["RTL_ALT"].minimum, infos["RTL_ALT"].maximum, infos["RTL_ALT"].unit) == (30.0, 300_000.0, "cm")
    assert infos["FS_GCS_ENABLE"].values == {0.0: "Disabled", 1.0: "RTL"}


def test_bits_of_ardupilots_xml_are_read() -> None:
    assert read_infos(ARDUPILOT_XML, "x")["MASK"].bits == {0: "A", 1: "B"}


@pytest.mark.parametrize(
    ("data", "complaint"),
    [
        (b"hello", "no description of parameters"),
        (b"{", "no JSON"),
        (b'{"parameters":[{"name":"A\xff"}]}', "no JSON"),
        (b'<?xml version="1.0" encoding="nope"?><a/>', "no XML: unknown encoding: nope"),
        (b"<a><b></a>", "x:1:9: it is no XML: mismatched tag$"),
        (b'<!DOCTYPE a [<!ENTITY b "c">]><a/>', "entities"),
        (lzma.compress(PX4)[:-8], "cut off"),
        (b"\xfd7zXZ\x00" + b"garbage" * 9, "cannot be unpacked"),
    ],
)
def test_what_is_none_is_refused(data: bytes, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        read_infos(data, "x")


def test_a_number_beyond_any_parameter_is_left_out() -> None:
    row = b'{"parameters":[{"name":"A","min":%s,"max":5}]}' % (b"9" * 400)
    assert read_infos(row, "x")["A"] == ParameterInfo(maximum=5.0)


def test_what_becomes_huge_when_it_is_unpacked_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parameter_info, "MAX_BYTES", 1000)
    with pytest.raises(InputError, match="too large"):
        read_infos(lzma.compress(PX4 + b" " * 1000), "x")


@pytest.mark.parametrize("letter", ["\x1b", "\u202e", "\u2066", "\x00", "\u200f"])
def test_no_name_or_text_steers_the_terminal(letter: str) -> None:
    rows = [
        {"name": f"A{letter}B", "shortDesc": "hidden"},
        {"name": "C", "shortDesc": f"x{letter}y", "units": letter, "values": [{"value": 1, "description": letter}]},
    ]
    infos = read_infos(msgspec.json.encode({"parameters": rows}), "p")
    assert list(infos) == ["C"], "a name is refused"
    assert (infos["C"].title, infos["C"].unit, infos["C"].values[1.0]) == ("x\ufffdy", "\ufffd", "\ufffd")
    groups = {f"G{letter}": {"D": {"DisplayName": f"x{letter}"}, f"E{letter}": {"DisplayName": "hidden"}}}
    infos = read_infos(msgspec.json.encode(groups), "p")
    assert {name: (info.title, info.group) for name, info in infos.items()} == {"D": ("x\ufffd", "G\ufffd")}


def test_no_name_in_xml_steers_the_terminal() -> None:
    text = ARDUPILOT_XML.replace(b"MASK", "MA\u202eSK".encode()).replace(b"RTL Altitude", "RTL \u202eA".encode())
    infos = read_infos(text, "x")
    assert sorted(infos) == ["FS_GCS_ENABLE", "RTL_ALT"]
    assert infos["RTL_ALT"].title == "RTL \ufffdA"


json = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["parameters", "name", "values", "min", "Range", "Bitmask", "A"]), inner, max_size=4
        )
    ),
    max_leaves=12,
)


@settings(max_examples=100)
@given(json)
def test_no_json_is_worse_than_a_finding(value: object) -> None:
    for data in ({"parameters": [value], "X": value}, {"X": value}):
        with suppress(InputError):
            read_infos(msgspec.json.encode(data), "x")
