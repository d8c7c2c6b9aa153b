"""Files of parameters: three programs' formats are read and written, and what is wrong is told with its place."""

from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.errors import InputError
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.parameter import Parameter, ParameterType, parameter
from gloc3_groundstation.services.parameter_files import (
    ParameterFormat,
    load_parameter_file,
    read_parameter_file,
    write_parameter_file,
)

QGC = """# Onboard parameters for Vehicle 1
#
# Stack: PX4 Pro
# Vehicle-Id Component-Id Name Value Type
1\t1\tBAT1_CAPACITY\t5000.000000000000000000\t9
1\t1\tCOM_DL_LOSS_T\t10\t6
1\t1\tMPC_XY_P\t0.949999988079071045\t9
"""
MAVPROXY = "ACRO_BAL_PITCH   1.000000\nARMING_CHECK     1\nATC_RAT_PIT_P    0.135000 # tuned\n"
MISSION_PLANNER = (
    "#NOTE: 3/1/2024\r\nACRO_BAL_PITCH,1\r\nARMING_CHECK,1\r\nATC_RAT_PIT_P,0.135\r\nBRD_SERIAL_NUM,0x1F @READONLY\r\n"
)


def read(text: str | bytes) -> dict[str, float]:
    data = text.encode() if isinstance(text, str) else text
    return {one.name: one.value for one in read_parameter_file(data, "a.params").parameters}


def complaints(text: str | bytes) -> list[str]:
    with pytest.raises(InputError) as error:
        read(text)
    return str(error.value).splitlines()


def test_the_files_of_three_programs_are_read() -> None:
    assert read(QGC) == {"BAT1_CAPACITY": 5000.0, "COM_DL_LOSS_T": 10.0, "MPC_XY_P": 0.949999988079071045}
    same = {"ACRO_BAL_PITCH": 1.0, "ARMING_CHECK": 1.0, "ATC_RAT_PIT_P": 0.135}
    assert read(MAVPROXY) == same
    assert read(MISSION_PLANNER) == same | {"BRD_SERIAL_NUM": 31.0}
    file = read_parameter_file(QGC.encode(), "a.params")
    assert [one.type for one in file.parameters] == [ParameterType.REAL32, ParameterType.INT32, ParameterType.REAL32]
    assert [one.line for one in file.parameters] == [5, 6, 7]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("A 1\nB x\n", "a.params:2:3: 'x' is no number that a parameter can hold"),
        ("A nan\n", "a.params:1:3: 'nan' is no number that a parameter can hold"),
        ("A 1e39\n", "a.params:1:3: '1e39' is no number that a parameter can hold"),
        ("A 1_0\n", "a.params:1:3: '1_0' is no number that a parameter can hold"),
        (
            "A,1,5\n",
            "a.params:1:5: a line of 3 columns is not understood (a name and a value, or QGroundControl's five columns)",
        ),
        (
            "A\n",
            "a.params:1:1: a line of 1 column is not understood (a name and a value, or QGroundControl's five columns)",
        ),
        ("1\t1\tA\t1.5\t6\n", "a.params:1:7: 1.5 is not whole, but A is an integer"),
        ("1\t1\tA\t1\t12\n", "a.params:1:9: '12' is no type of a parameter (1 to 6, or 9 for a float)"),
        ("A 1\nA 2\n", "a.params:2:1: A appears again, with another value than in line 1 (take one of them out)"),
        ("LONGER_THAN_16_CHARS 1\n", "a.params:1:1: 'LONGER_THAN_16_CHARS' is no name of a parameter"),
        ("@INCLUDE other.parm\n", "a.params:1:1: @INCLUDE is not followed (copy the lines of that file into this one)"),
        ("# nothing\n", "a.params: there are no parameters in it"),
        ("", "a.params: there are no parameters in it"),
        (b"A \xff\n", "a.params: not UTF-8 text (a file of parameters is plain text)"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(text: str | bytes, expected: str) -> None:
    assert complaints(text)[0].startswith(expected)


def test_all_that_is_wrong_is_told_at_once_but_not_without_end() -> None:
    assert len(complaints("A x\nB y\n1 z\n")) == 3
    assert len(complaints("A x\n" * 1000)) == 20


def test_a_parameter_that_stands_twice_with_one_value_is_a_warning() -> None:
    file = read_parameter_file(b"A 1\nA 1.0\n", "a.parm")
    assert [one.name for one in file.parameters] == ["A"]
    assert [str(finding) for finding in file.warnings] == ["a.parm:2:1: warning: A appears twice"]


def test_six_decimals_are_taken_for_rounded_and_more_are_not() -> None:
    rounded, exact = (read_parameter_file(text, "a").parameters[0] for text in (b"A 0.000012", b"A 0.0000123"))
    assert rounded.is_same(0.0000123)
    assert not rounded.is_same(0.0000136)
    assert not exact.is_same(0.0000124)


def test_a_file_that_is_not_there_or_huge_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_parameter_file(tmp_path / "none.parm")
    with pytest.raises(InputError, match="too large"):
        read_parameter_file(b"#" * 5_000_001, "a")


names = st.from_regex(r"[A-Z][A-Z0-9_]{0,15}", fullmatch=True)
floats = st.floats(width=32, allow_nan=False, allow_infinity=False)
parameters = st.one_of(
    st.builds(parameter, names, floats),
    st.builds(lambda name, value: parameter(name, value, ParameterType.INT32), names, st.integers(-(2**31), 2**31 - 1)),
    st.builds(lambda name, value: parameter(name, value, ParameterType.UINT8), names, st.integers(0, 255)),
)


@settings(max_examples=60)
@given(st.lists(parameters, min_size=1, max_size=8, unique_by=lambda one: one.name), st.sampled_from(ParameterFormat))
def test_what_is_written_is_read_as_the_same(rows: list[Parameter], form: ParameterFormat) -> None:
    text = write_parameter_file(rows, form, Address(1, 1), ["PX4, system 1"])
    found = {one.name: one for one in read_parameter_file(text.encode(), "a").parameters}
    assert sorted(found) == sorted(row.name for row in rows)
    for row in rows:
        assert found[row.name].is_same(row.value)
        assert parameter(row.name, found[row.name].value, row.type) == row


@settings(max_examples=150)
@given(st.one_of(st.binary(max_size=80), st.text(max_size=80).map(str.encode)))
def test_no_input_is_worse_than_findings(data: bytes) -> None:
    with suppress(InputError):
        for one in read_parameter_file(data, "a").parameters:
            assert parameter(one.name, one.value)
