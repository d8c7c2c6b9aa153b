"""The descriptions that GLOC3 ships: they describe what simulated vehicles have, and agree with it."""

from importlib.resources import files

import pytest

from gloc3_groundstation.services.descriptions.parameter_info import ParameterInfo, info_of, read_infos
from gloc3_groundstation.services.descriptions.shipped import layered, shipped_infos
from gloc3_groundstation.services.snapshot import Firmware
from gloc3_sitl.autopilot.parameters import AutopilotParameter
from gloc3_sitl.autopilot.styles import ardupilot_parameters, px4_parameters

COPTER, PLANE = 2, 1
VEHICLES = {
    Firmware.PX4: px4_parameters.PARAMETERS,
    Firmware.ARDUPILOT: ardupilot_parameters.PARAMETERS,
}


@pytest.mark.parametrize("firmware", list(VEHICLES))
def test_most_parameters_of_a_simulated_vehicle_are_described_and_their_values_fit(firmware: Firmware) -> None:
    infos = shipped_infos(firmware, COPTER)
    found = [(row, info) for row in VEHICLES[firmware] if (info := info_of(infos, row.name)) is not None]
    assert len(found) > 0.75 * len(VEHICLES[firmware])
    for row, info in found:
        assert _fits(row, info), (row.name, info)


def _fits(row: AutopilotParameter, info: ParameterInfo) -> bool:
    is_inside = (info.minimum is None or info.minimum <= row.default) and (
        info.maximum is None or row.default <= info.maximum
    )
    return is_inside and (not info.values or row.default in info.values or row.name == "SYS_AUTOSTART")


def test_bounds_of_px4_are_those_of_its_reference() -> None:
    infos = shipped_infos(Firmware.PX4, COPTER)
    for row in px4_parameters.PARAMETERS:
        info = info_of(infos, row.name)
        if info is not None:
            assert info.minimum in (None, row.minimum), row.name
            assert info.maximum in (None, row.maximum), row.name


def test_every_row_says_something_and_every_file_is_read_whole() -> None:
    for name in ("px4", "ardupilot", "arducopter"):
        data = (files("gloc3_groundstation.services.descriptions") / f"{name}.json").read_bytes()
        infos = read_infos(data, name)
        assert len(infos) == data.count(b'"name"')
        for info in infos.values():
            assert info.title
            assert "\ufffd" not in info.title


def test_what_copters_and_planes_mean_differently_is_described_for_copters_alone() -> None:
    assert shipped_infos(Firmware.ARDUPILOT, COPTER)["FS_GCS_ENABLE"].values[1.0] == "return"
    assert "FS_GCS_ENABLE" not in shipped_infos(Firmware.ARDUPILOT, PLANE)
    assert "BATT_CAPACITY" in shipped_infos(Firmware.ARDUPILOT, PLANE)
    assert shipped_infos(Firmware.OTHER, COPTER) == {}


def test_the_vehicles_own_description_wins() -> None:
    shipped = shipped_infos(Firmware.PX4, COPTER)
    both = layered({"RC{n}_MIN": ParameterInfo(title="own"), "NAV_DLL_ACT": ParameterInfo(title="mine")}, shipped)
    named = {name: info_of(both, name) for name in ("RC3_MIN", "NAV_DLL_ACT", "RC3_MAX")}
    assert {name: info.title for name, info in named.items() if info is not None} == {
        "RC3_MIN": "own",
        "NAV_DLL_ACT": "mine",
        "RC3_MAX": "longest pulse of RC channel 3",
    }
    assert shipped["RC{n}_MAX"].origin == "GLOC3's table for PX4 1.16"
