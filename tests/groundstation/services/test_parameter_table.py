"""The table of parameters: searching, bounds, what is typed, and the comparison with a file."""

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.services.parameter import ParameterType, parameter
from gloc3_groundstation.services.descriptions.parameter_info import ParameterInfo
from gloc3_groundstation.services.parameter_files import read_parameter_file
from gloc3_groundstation.services.parameter_table import DiffKind, ParameterChange, ParameterTable

INFOS = {
    "NAV_DLL_ACT": ParameterInfo(
        title="Data link loss action", minimum=0, maximum=3, values={0: "Off", 2: "Return"}, default=0
    ),
    "MPC_XY_VEL": ParameterInfo(title="Speed over ground", minimum=0.1, maximum=20.0, unit="m/s", default=5.0),
    "SERIAL_NO": ParameterInfo(is_read_only=True),
    "FLAGS": ParameterInfo(bits={0: "first", 1: "second", 3: "fourth"}),
}
ROWS = [
    parameter("NAV_DLL_ACT", 2, ParameterType.INT32),
    parameter("MPC_XY_VEL", 5.0),
    parameter("MPC_Z_VEL", 1.5),
    parameter("SERIAL_NO", 77, ParameterType.UINT16),
    parameter("FLAGS", 9, ParameterType.UINT8),
    parameter("RC1_MIN", 1000, ParameterType.INT16),
]
TABLE = ParameterTable.of({row.name: row for row in ROWS}, INFOS, is_complete=True)


def names(**how: object) -> list[str]:
    return [row.name for row in TABLE.find(**how)]  # type: ignore[arg-type]


def test_rows_are_in_the_order_of_their_names_and_say_what_they_mean() -> None:
    assert [row.name for row in TABLE] == sorted(row.name for row in ROWS)
    assert TABLE["NAV_DLL_ACT"].meaning == "Return"
    assert TABLE["FLAGS"].meaning == "first, fourth"
    assert (TABLE["MPC_Z_VEL"].meaning, TABLE["MPC_Z_VEL"].text, TABLE["MPC_Z_VEL"].group) == ("", "1.5", "MPC")
    assert [TABLE[name].is_default for name in ("NAV_DLL_ACT", "MPC_XY_VEL", "MPC_Z_VEL")] == [False, True, None]


def test_parameters_are_found_by_name_title_pattern_and_group() -> None:
    assert names(text="mpc") == ["MPC_XY_VEL", "MPC_Z_VEL"]
    assert names(text="vel z") == ["MPC_Z_VEL"]
    assert names(text="ground") == ["MPC_XY_VEL"]
    assert names(text="*_?_vel") == ["MPC_Z_VEL"]
    assert names(text="a") == ["FLAGS", "NAV_DLL_ACT", "SERIAL_NO"]
    assert names(group="RC1") == ["RC1_MIN"]
    assert names(not_default=True) == ["NAV_DLL_ACT"]
    assert names(text="nothing of this kind") == []


def test_those_whose_name_begins_with_the_text_come_first() -> None:
    assert names(text="l")[0] == "FLAGS"
    assert names(text="mi") == ["RC1_MIN"]
    assert names(text="n")[0] == "NAV_DLL_ACT"


def test_a_change_is_seen_until_it_is_taken_back() -> None:
    changed = TABLE.with_value(parameter("MPC_Z_VEL", 2.0))
    assert [row.name for row in changed.find(changed=True)] == ["MPC_Z_VEL"]
    assert changed.with_value(parameter("MPC_Z_VEL", 1.5)).find(changed=True) == []
    assert TABLE.find(changed=True) == []


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("NAV_DLL_ACT", 4, "NAV_DLL_ACT must be at most 3, not 4"),
        ("MPC_XY_VEL", 0.0, "MPC_XY_VEL must be at least 0.1 m/s, not 0"),
        ("SERIAL_NO", 78, "SERIAL_NO is read-only"),
        ("RC1_MIN", 40_000, "cannot be 40000"),
        ("RC1_MIN", 1.5, "is an integer"),
        ("MPC_Z_VELO", 1, "no parameter 'MPC_Z_VELO': did you mean 'MPC_Z_VEL'"),
    ],
)
def test_a_value_out_of_bounds_is_refused_with_the_bounds(name: str, value: float, reason: str) -> None:
    with pytest.raises(Refused, match=reason):
        TABLE.check(name, value)


def test_bounds_of_the_description_can_be_overruled_those_of_the_type_cannot() -> None:
    assert TABLE.check("NAV_DLL_ACT", 6, force=True).value == 6
    assert TABLE.check("MPC_XY_VEL", 0.1).value == pytest.approx(0.1)
    with pytest.raises(Refused):
        TABLE.check("RC1_MIN", 40_000, force=True)


@pytest.mark.parametrize("text", ["nan", "-nan", "inf", "-inf"])
@pytest.mark.parametrize("name", ["MPC_XY_VEL", "MPC_Z_VEL"])
def test_nothing_is_set_to_what_is_no_number_or_infinite(name: str, text: str) -> None:
    for is_forced in (False, True):
        with pytest.raises(Refused, match=f"{name} must be a number, not -?(nan|inf)"):
            TABLE.check(name, TABLE.parse(name, text), force=is_forced)


def test_what_is_typed_is_a_number_or_what_the_value_is_called() -> None:
    assert [TABLE.parse("NAV_DLL_ACT", text) for text in (" 1 ", "0x2", "return")] == [1.0, 2.0, 2.0]
    with pytest.raises(Refused, match="'retrun' is no value for NAV_DLL_ACT; did you mean 'Return'"):
        TABLE.parse("NAV_DLL_ACT", "retrun")


def test_a_file_is_compared_before_anything_is_written() -> None:
    text = b"MPC_Z_VEL 3\nNAV_DLL_ACT 9\nRC1_MIN 1000\nNEW_ONE 1\nSERIAL_NO 5\nMPC_XY_VEL 5.000000\n"
    diff = TABLE.compare(read_parameter_file(text, "a.parm"))
    kinds = {row.name: row.kind for row in diff.rows}
    assert kinds == {
        "MPC_Z_VEL": DiffKind.DIFFERENT,
        "NAV_DLL_ACT": DiffKind.NOT_ALLOWED,
        "RC1_MIN": DiffKind.SAME,
        "NEW_ONE": DiffKind.ONLY_IN_FILE,
        "SERIAL_NO": DiffKind.NOT_ALLOWED,
        "MPC_XY_VEL": DiffKind.SAME,
        "FLAGS": DiffKind.ONLY_ON_VEHICLE,
    }
    (different,) = diff.of(DiffKind.DIFFERENT)
    assert (different.vehicle, different.file, different.line) == (1.5, 3.0, 1)
    assert diff.of(DiffKind.NOT_ALLOWED)[0].reason == "NAV_DLL_ACT must be at most 3, not 9"
    assert diff.changes() == (ParameterChange("MPC_Z_VEL", 3.0),)
    assert diff.changes(frozenset({"MPC_Z_VEL"})) == ()
