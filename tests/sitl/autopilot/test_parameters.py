"""The parameters of both styles: tables, bounds, what they change, and how they travel."""

from struct import pack, unpack

import pytest

from gloc3.errors import Refused
from gloc3_sitl.autopilot.parameters import ParameterKind, ParameterStore
from gloc3_sitl.autopilot.styles.ardupilot import ARDUPILOT
from gloc3_sitl.autopilot.styles.px4 import PX4
from gloc3_sitl.autopilot.tuning import FailsafeAction, Tuning

from .bench import Bench

STYLES = pytest.mark.parametrize("style", [PX4, ARDUPILOT], ids=lambda style: str(style.name))


def bits(value: float) -> int:
    return int.from_bytes(pack("<f", value), "little")


@STYLES
def test_every_default_lies_within_its_bounds_and_every_name_fits(style: object) -> None:
    for row in style.parameters:  # type: ignore[attr-defined]
        assert row.minimum <= row.default <= row.maximum, row.name
        assert len(row.name) <= 16
        assert row.what


@STYLES
def test_every_parameter_that_sets_something_changes_the_tuning(style: object) -> None:
    for row in style.parameters:  # type: ignore[attr-defined]
        if not row.sets:
            continue
        changed = ParameterStore((row,), Tuning())
        other = row.maximum if row.default != row.maximum else row.minimum
        before = repr(changed.tuning)
        changed.set(row.name, other)
        if row.means is None or row.means.get(int(other)) not in (None, row.means[int(row.default)]):
            assert repr(changed.tuning) != before, row.name


def test_a_value_out_of_bounds_is_refused_and_the_old_one_stays() -> None:
    store = ParameterStore(PX4.parameters, Tuning(), PX4.derive)
    for value in (7.0, -1.0, 0.5, float("nan"), float("inf")):
        with pytest.raises(Refused):
            store.set("NAV_DLL_ACT", value)
    assert store["NAV_DLL_ACT"] == 0
    with pytest.raises(Refused, match="MPC_XY_CRUISE"):
        store.set("MPC_XY_CRUSE", 5.0)


def test_choices_become_actions() -> None:
    tuning = Tuning()
    store = ParameterStore(PX4.parameters, tuning, PX4.derive)
    store.set("NAV_DLL_ACT", 2)
    store.set("COM_LOW_BAT_ACT", 3)
    store.set("GF_ACTION", 5)
    chosen = (tuning.station_lost_action, tuning.battery_critical_action, tuning.battery_emergency_action)
    assert chosen == (FailsafeAction.RETURN, FailsafeAction.RETURN, FailsafeAction.LAND)
    assert tuning.fence_action is FailsafeAction.LAND
    store.reset()
    assert tuning.station_lost_action == FailsafeAction.NONE


def test_all_parameters_are_listed_once() -> None:
    for style in ("px4", "ardupilot"):
        bench = Bench(style)
        bench.send("PARAM_REQUEST_LIST", target_system=1, target_component=1)
        bench.run(2.0)
        reported = [received for received in bench.received if received.name == "PARAM_VALUE"]
        assert len({received.param_id for received in reported}) == len(reported) == reported[0].param_count
        assert len(reported) > 40


def test_integers_travel_bytewise_in_px4_and_as_floats_in_ardupilot() -> None:
    for style, name, raw in (("px4", "NAV_DLL_ACT", 2), ("ardupilot", "FS_GCS_ENABLE", bits(5.0))):
        bench = Bench(style)
        kind = ParameterKind.INT32 if style == "px4" else ParameterKind.INT8
        bench.send(
            "PARAM_SET", target_system=1, target_component=1, param_id=name, param_value=raw, param_type=int(kind)
        )
        reported = bench.last("PARAM_VALUE")
        assert (reported.param_id, reported.param_value, reported.param_type) == (name, raw, int(kind))
    assert bench.autopilot.tuning.station_lost_action is FailsafeAction.LAND


def test_a_float_is_set_from_the_ground_and_used() -> None:
    bench = Bench()
    bench.send(
        "PARAM_SET",
        target_system=1,
        target_component=1,
        param_id="MIS_TAKEOFF_ALT",
        param_value=bits(4.5),
        param_type=9,
    )
    assert unpack("<f", bench.last("PARAM_VALUE").param_value.to_bytes(4, "little"))[0] == 4.5
    assert bench.autopilot.tuning.takeoff_height_m == 4.5


def test_a_value_out_of_bounds_from_the_ground_is_answered_with_the_old_one() -> None:
    bench = Bench()
    bench.send("PARAM_SET", target_system=1, target_component=1, param_id="NAV_DLL_ACT", param_value=99, param_type=6)
    assert bench.last("PARAM_VALUE").param_value == 0
    assert bench.counts["PARAM_ERROR"] == 1


def test_a_change_from_inside_is_told_to_everybody() -> None:
    bench = Bench()
    bench.set_parameter("RTL_RETURN_ALT", 12.0)
    bench.run(0.1)
    assert bench.last("PARAM_VALUE").param_id == "RTL_RETURN_ALT"
