"""YAML files are read with places, or refused with everything that is wrong in them, and never with a traceback."""

from pathlib import Path
from typing import Annotated, Literal

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.documents.document import load, load_bytes, parse, read
from gloc3.errors import InputError


class Leg(msgspec.Struct, forbid_unknown_fields=True):
    points: list[tuple[float, float, float]]
    speed_m_s: Annotated[float, msgspec.Meta(gt=0, le=20)] = 1.0
    heading: Literal["along", "hold"] | float = "along"


class Plan(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    legs: dict[Annotated[str, msgspec.Meta(pattern="^[a-z]+$")], Leg] = {}
    arm: bool = False


def findings(data: bytes | str, kind: type = dict) -> list[str]:
    with pytest.raises(InputError) as caught:
        read(data, kind, "f")
    return [str(finding) for finding in caught.value.findings]


def test_a_document_becomes_a_structure() -> None:
    plan = read("name: x\narm: yes\nlegs: {a: {points: [[1, 2, 3.5]], heading: 90}}", Plan, "f")
    assert plan == Plan(name="x", arm=True, legs={"a": Leg(points=[(1, 2, 3.5)], heading=90)})


def test_everything_that_does_not_fit_is_found_at_once_with_its_place_and_a_hint() -> None:
    text = """\
name: no
legs:
  A: {points: [[1, 2], [1, 2, far]], speed: 3, speed_m_s: 30}
  b: 3
  c: {heading: alon}
nam: 3
"""
    assert findings(text, Plan) == [
        "f:1:7: name: expected text, got true or false (False) (put it in quotes)",
        "f:3:3: name 'A': expected text matching regex '^[a-z]+$'",
        "f:3:16: points[0]: expected a list of length 3, got 2",
        "f:3:31: points[1][2]: expected a number, got text (far)",
        "f:3:38: unknown key 'speed' (did you mean 'speed_m_s'?)",
        "f:3:59: speed_m_s: expected a number <= 20.0 (30)",
        "f:4:6: b: expected a mapping, got a whole number (3)",
        "f:5:6: 'points' is missing in c",
        "f:5:16: heading: 'alon' is not possible here (did you mean 'along'?)",
        "f:6:1: unknown key 'nam' (did you mean 'name'?)",
    ]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e3", 1000.0),
        ("-.5", -0.5),
        ("0x10", 16),
        ("007", 7),
        ("1:30", "1:30"),
        ("2026-01-01", "2026-01-01"),
        ("'1'", "1"),
        ("~", None),
        ("off", "off"),
        ("no", False),
        ("{on: 1, 2: 3}", {"on": 1, "2": 3}),
    ],
)
def test_plain_values_follow_the_core_schema_and_keys_stay_text(text: str, value: object) -> None:
    assert parse(text, "f").value == value


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ("", "f: the file is empty"),
        ("# nothing", "f: the file is empty"),
        (b"a: b\xff", "f:1:5: not UTF-8 text (save the file as UTF-8)"),
        ("a:\n\t- b", "f:2:1: a tab in the indentation (YAML allows spaces only)"),
        ('a: "\x00"', "f:1:5: character 0 is not allowed (is this a text file?)"),
        ("a: 1\n---\nb: 2", "f:2:1: a second document starts here (one file holds one document; remove the '---')"),
        ("? [a]\n: b", "f:1:3: a key must be text, not a list or mapping"),
        ("[" * 100, "f:1:33: nested more than 32 deep"),
        ("a: .nan", "f:1:4: .nan is not a finite number"),
        ("a: -.inf", "f:1:4: -.inf is not a finite number"),
        ("a: 1e999", "f:1:4: the number 1e999 is out of range"),
        ("a: " + "9" * 5000, f"f:1:4: the number {'9' * 40} is out of range"),
        (
            "a: !!python/name:os.system x",
            "f:1:4: tag tag:yaml.org,2002:python/name:os.system is not supported (leave the tag out)",
        ),
        ("a: 1\nb: {c: 2, c: 3}", "f:2:11: 'c' is given twice (first in line 2)"),
        pytest.param(
            *("[" + "0," * 60_000 + "0]", "f:1:100000: more than 50,000 values in one file"),
            marks=pytest.mark.thorough,
        ),
        ("x" * 1_000_001, "f: 1.000001 MB is too large: the limit is 1 MB (is this the right file?)"),
    ],
    ids=lambda value: repr(value[:12]),
)
def test_bad_yaml_is_refused_with_its_place(data: bytes | str, expected: str) -> None:
    assert findings(data) == [expected]


def test_a_yaml_bomb_is_refused_at_its_anchors() -> None:
    bomb = "a: &a [x, x]\n" + "".join(
        f"{chr(98 + i)}: &{chr(98 + i)} [*{chr(97 + i)}, *{chr(97 + i)}]\n" for i in range(8)
    )
    found = findings(bomb)
    assert found[0] == "f:1:4: anchor &a is not supported (write the value out where it is used)"
    assert found[1:3] == [
        "f:2:4: anchor &b is not supported (write the value out where it is used)",
        "f:2:8: alias *a is not supported (write the value out)",
    ]


def test_a_large_file_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "large.yaml"
    path.write_bytes(b"")
    with path.open("r+b") as file:
        file.truncate(10_000_000)
    with pytest.raises(InputError, match=r"10\.0 MB is too large"):
        load(path, dict)


def test_what_never_ends_is_refused_too() -> None:
    with pytest.raises(InputError, match=r"the limit is 1 MB"):
        load_bytes(Path("/dev/zero"))


def test_a_file_that_cannot_be_opened_is_a_finding(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read: no such file or directory"):
        load_bytes(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="cannot be read: is a directory"):
        load_bytes(tmp_path)


def test_a_finding_can_be_made_about_any_value_or_key() -> None:
    document = parse("a: 1\nb: [1, {c: 2}]\n", "f")
    assert str(document.finding(("b", 1, "c"), "odd")) == "f:2:12: odd"
    assert str(document.finding(("b", 1, "c"), "odd", at_key=True)) == "f:2:9: odd"
    assert str(document.finding(("b", 7), "odd", is_warning=True)) == "f:2:4: warning: odd"


@given(st.binary(max_size=60) | st.text(max_size=60) | st.text(alphabet="ab:-[]{}&*!?|>#'\"\n\t ,.0e~%@", max_size=60))
@settings(max_examples=200)
def test_any_bytes_give_a_document_or_findings(data: bytes | str) -> None:
    def outcome(kind: type) -> object:
        try:
            return read(data, kind, "f")
        except InputError as error:
            return error.findings

    assert outcome(Plan)
    assert outcome(dict) or not parse(data, "f").value


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63) + 1, 2**63 - 1)
    | st.floats(allow_nan=False, allow_infinity=False, min_value=-1e18, max_value=1e18)
    | st.text(alphabet=st.characters(codec="ascii", exclude_categories=["Cc"]), max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(alphabet="abcxyz", max_size=3), inner, max_size=4)
    ),
    max_leaves=12,
)


@given(JSON)
@settings(max_examples=100)
def test_what_json_writes_is_read_as_it_was(value: object) -> None:
    assert parse(msgspec.json.encode(value), "f").value == value
